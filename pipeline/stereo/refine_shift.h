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
/// @param start_px disparities, NaN where the pixel does not count
void WarpRow(const float* left, const float* left_counts, const float* right_coefficients, const float* right_counts,
             const float* start_px, int width, const MatchedRow& out);

/// Rows of column sums: n, L, R, G, LL, RR, GG, LR, LG, RG.
constexpr int kMatchSums = 10;

/// Adds the products of one row to the columns and takes those of another away.
void SlideMatchColumns(const MatchedRow& enters, const MatchedRow& leaves, int width, float* const sums[kMatchSums]);

/// Sums of `columns` over x − radius … x + radius. @param scratch four rows
void SumWindows(const float* columns, int radius, int width, float* const scratch[4], float* sums);

struct ShiftRow {
  float* delta_px;      ///< what the start lacks; NaN where the window gives none
  float* deviation_px;  ///< its standard deviation if the residuals are white noise; NaN likewise
};
/// Solves `L = gain · R − δ G + offset` in each window. @param gain_scale gains between 0.2 and 5 times this are
/// believed; @param scores the middle pixel's own share in δ, over its expected size; nullptr: not wanted
void SolveRow(float* const sums[kMatchSums], const MatchedRow& middle, float gain_scale, int radius, int width,
              const ShiftRow& shift, float* scores);

/// Adds q·q and the products of q with its neighbours one and two to the right and one below to four rows of sums.
void AddScoreProducts(const float* scores, const float* scores_above, int width, float* const products[4]);

}  // namespace granary
