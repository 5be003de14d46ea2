// Pixels that carry nothing to be matched.
#pragma once

#include <opencv2/core/mat.hpp>

namespace granary {

/// Where each picture of a pair may be believed: CV_8UC1, 0 where not; an empty mask leaves every pixel in.
struct UsablePixels {
  cv::Mat left, right;
};

/// 255 on saturated areas: full pixels with many full ones around, and what lies between them. The full cores of single
/// dots stay out of it; their flanks can be matched.
/// @param full CV_8UC1, 255 where the sensor was full
[[nodiscard]] cv::Mat SaturatedAreas(const cv::Mat& full);

/// 255 where every pixel of the window around a pixel is the same, saturated or black: there is nothing to compare, and
/// the paths would carry a neighbour's disparity, or the least one, into it. Empty where there is no such pixel.
/// @param grey CV_32FC1, not empty
[[nodiscard]] cv::Mat WithoutTexture(const cv::Mat& grey, int window_width, int window_height);

}  // namespace granary
