// Pictures for people: maps with colour bar, axes and units. All are 8-bit BGR (CV_8UC3).
#pragma once

#include <string>

#include <opencv2/core/mat.hpp>

#include "pipeline/surface.h"
#include "pipeline/types/bin.h"

namespace granary {

/// The grain's height over the floor seen from above: x to the right, y up, metres; the footprint outlined, excluded
/// floor hatched, completed (not measured) grain dotted.
[[nodiscard]] cv::Mat HeightPicture(const Surface& surface, const Bin& bin, const std::string& title);

/// @param disparity_px H×W, CV_32FC1; not finite: grey
[[nodiscard]] cv::Mat DisparityPicture(const cv::Mat& disparity_px, const std::string& title);

/// The rectified pair side by side with a line every 64 rows: a point and its partner lie on one line.
/// @param left,right H×W, CV_8UC1, CV_16UC1 or CV_32FC1; stretched alike to the brightest 0.1 %
[[nodiscard]] cv::Mat RectifiedPicture(const cv::Mat& left, const cv::Mat& right);

/// The left picture with the grain tinted.
/// @param left as above  @param grain_mask H×W, CV_8UC1, 255 where grain
[[nodiscard]] cv::Mat MaskPicture(const cv::Mat& left, const cv::Mat& grain_mask, const std::string& title);

}  // namespace granary
