// The shifts of all windows of a band of rows, and what becomes of its pixels.
#pragma once

#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "pipeline/stereo/refine_rows.h"
#include "pipeline/stereo/refine_shift.h"
#include "pipeline/stereo/refine_starts.h"

namespace granary {

/// Both pictures, and what all bands need to know of them.
struct RefinePictures {
  const cv::Mat &left, &right;                ///< CV_32FC1
  const cv::Mat &left_usable, &right_usable;  ///< CV_8UC1 or empty
  float left_mean, right_mean;
  float gain_scale;  ///< contrast of the left picture over that of the right one
  std::vector<float> filter = SplineFilter();
};

/// What one thread needs to solve a band; used again for the next band.
struct ShiftBuffers {
  ShiftBuffers(int radius, int width);
  RowRing left, gradient, right, counts, none;  // warped rows: a window's height and the row that left it
  RowRing left_grey, right_grey, coefficients, usable, start;  // of the row that is being warped
  RowRing columns, quads;                                      // sums of products
  RowRing delta, deviation, shifted_delta, shifted_deviation;
  RowRing scores, products, finished;
};

/// One pass over the rows y0 … y1 − 1: every valid disparity becomes start + δ.
/// @param start_px, window from FindStarts
void MoveBand(const RefinePictures& pictures, const cv::Mat& start_px, const cv::Mat& window, int radius, int y0,
              int y1, ShiftBuffers& buffers, cv::Mat& disparity_px);

/// The last pass: writes results and deviations (as if residuals were white noise) of the rows y0 … y1 − 1.
/// @param before_px the disparities before all passes
/// @param score_products receives four sums over the band: q·q, and q with its neighbours one and two to the right and
///   one above, q being the pixels' shares in δ
void FinishBand(const RefinePictures& pictures, const cv::Mat& start_px, const cv::Mat& window, int radius, int y0,
                int y1, const cv::Mat& before_px, const RefineLimits& limits, ShiftBuffers& buffers,
                cv::Mat& disparity_px, cv::Mat& deviation_px, double* score_products);

}  // namespace granary
