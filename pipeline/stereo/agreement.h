// Whether two windows show the same thing.
#pragma once

#include <opencv2/core/mat.hpp>

namespace granary {

/// Share of the left window's contrast that the right window explains, 0 … 1: the square of their correlation, 0 where
/// it is negative, where either window is flat, or where the right one leaves the picture.
/// @param left, right CV_32FC1, one size
/// @param half_width_px, half_height_px of both windows; what lies outside the left picture is left out
[[nodiscard]] double ExplainedContrast(const cv::Mat& left, const cv::Mat& right, int x, int y, double disparity_px,
                                       int half_width_px, int half_height_px);

}  // namespace granary
