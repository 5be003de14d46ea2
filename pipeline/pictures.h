// Pictures for people: maps with colour bar, axes and units. All are 8-bit BGR (CV_8UC3).
#pragma once

#include <string>

#include <opencv2/core/mat.hpp>

#include "pipeline/removed.h"
#include "pipeline/surface.h"
#include "pipeline/types/bin.h"

namespace granary {

/// The grain's height over the floor seen from above: x to the right, y up, metres; contour lines at round heights, the
/// footprint outlined, excluded floor hatched, completed (not measured) grain dotted. Lines come from a smoothed copy;
/// a surface that is flatter than its noise has none.
/// @throws std::invalid_argument when the footprint has no corners; so do the next two
[[nodiscard]] cv::Mat HeightPicture(const Surface& surface, const Bin& bin, const std::string& title);

/// The surface seen obliquely in parallel projection, shaded by its triangles' normals: measured in the colour of
/// grain, completed in blue. The bin's walls are drawn as edges, dashed where the grain hides them. Heights are not
/// exaggerated.
[[nodiscard]] cv::Mat MeshPicture(const Surface& surface, const Bin& bin, const std::string& title);

/// The points of one rig seen from above: those kept faint, those removed in the colour of why, with their numbers.
/// @param points_in_world, grain_mask what `removed` was found in
[[nodiscard]] cv::Mat RemovedPicture(const cv::Mat& points_in_world, const cv::Mat& grain_mask,
                                     const RemovedPoints& removed, const Bin& bin, const std::string& title);

/// @param disparity_px H×W, CV_32FC1; not finite: grey
[[nodiscard]] cv::Mat DisparityPicture(const cv::Mat& disparity_px, const std::string& title);

/// The rectified pair side by side with a line every 64 rows: a point and its partner lie on one line.
/// @param left,right H×W, CV_8UC1, CV_16UC1 or CV_32FC1; stretched alike to the brightest 0.1 %
[[nodiscard]] cv::Mat RectifiedPicture(const cv::Mat& left, const cv::Mat& right);

/// The left picture with the grain tinted.
/// @param left as above  @param grain_mask H×W, CV_8UC1, 255 where grain
[[nodiscard]] cv::Mat MaskPicture(const cv::Mat& left, const cv::Mat& grain_mask, const std::string& title);

}  // namespace granary
