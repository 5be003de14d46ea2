// The shift that least squares on grey values finds in each window, for whole rows at once.
#pragma once

#include <vector>

namespace granary {

/// Weights of the filter that turns grey values into the coefficients of a quintic B-spline through them: the middle
/// one, then those at distance 1, 2, … Source: Unser, Aldroubi, Eden 1993, B-spline signal processing.
[[nodiscard]] std::vector<float> SplineFilter();

/// `coefficients[x] = Σ filter[|i|] grey[x + i]`; `grey` needs filter.size() − 1 more values at both ends.
void FilterRow(const float* grey, const std::vector<float>& filter, int width, float* coefficients);

/// What the normal equations need of a row of pixels; all are 0 where the pixel does not count.
struct MatchedRow {
  float *left, *gradient;  ///< left picture and its derivative along the row
  float* right;            ///< right picture at x − disparity
  float* counts;           ///< 1 or 0
};
/// @param left grey values less a constant; @param left_counts 1 where `left` may be used, else 0
/// @param right_coefficients from FilterRow; @param right_counts 1 where all six values around [x, x + 1] may be used,
/// nullptr: everywhere
/// @param start_px disparities, NaN where the pixel does not count and for two pixels beyond either end
void WarpRow(const float* left, const float* left_counts, const float* right_coefficients, const float* right_counts,
             const float* start_px, int width, const MatchedRow& out);

/// Rows of column sums: n, L, R, G, LL, RR, GG, LR, LG, RG.
constexpr int kMatchSums = 10;

/// Adds the products of one row to the columns and takes those of another away.
void SlideMatchColumns(const MatchedRow& enters, const MatchedRow& leaves, int width, float* const sums[kMatchSums]);

/// `quads[x] = columns[x] + … + columns[x + 3]`, from a window before the first pixel to one after the last: whole
/// windows are put together from these.
void SumQuads(float* const columns[kMatchSums], int width, float* const quads[kMatchSums]);

struct ShiftRow {
  float* delta_px;      ///< what the start lacks; NaN where the window gives none
  float* deviation_px;  ///< its standard deviation if the residuals are white noise; NaN likewise
};
/// Solves `L = gain · R − δ G + offset` in each window of 2 · radius + 1 columns. @param gain_scale gains between 0.2
/// and 5 times this are believed; @param scores the middle pixel's own share in δ, over its expected size; nullptr: not
/// wanted
void SolveRow(float* const columns[kMatchSums], float* const quads[kMatchSums], const MatchedRow& middle,
              float gain_scale, int radius, int width, const ShiftRow& shift, float* scores);

/// `disparity = start + δ`, δ within ±1 px and 0 where there is none; left as it is where `start_px` is NaN.
void MoveRow(const float* start_px, const float* delta_px, int width, float* disparity_px);

/// When a pixel is believed.
struct RefineLimits {
  float max_shift_px, max_delta_px;  ///< largest move away from the start of all passes, and of the last one alone
  float unrefined_deviation_px;      ///< a refined pixel must do better
};
/// Writes the refined disparity and its deviation where they are believed, elsewhere `before_px` and the deviation of
/// an unrefined pixel, NaN for an invalid one.
void FinishRow(const float* before_px, const float* start_px, const ShiftRow& shift, const RefineLimits& limits,
               int width, float* disparity_px, float* deviation_px);

/// Adds q·q and the products of q with its neighbours one and two to the right and one below to four rows of sums.
void AddScoreProducts(const float* scores, const float* scores_above, int width, float* const products[4]);

}  // namespace granary
