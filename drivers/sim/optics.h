// The direction in which each pixel of a distorted camera looks.
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/matx.hpp>
#include <opencv2/core/types.hpp>

namespace granary {

/// Lens and chip of one camera: pixels, pixel centres at integers; distortion in OpenCV's order.
struct Optics {
  cv::Size size;
  cv::Matx33d K;
  std::vector<double> D;
};

/// The point (x, y) of the plane z = 1 that the distorted pixel shows, to 1e-6 px.
[[nodiscard]] Eigen::Vector2d RayOf(const Optics& optics, const cv::Point2d& pixel);

/// RayOf every pixel, CV_32FC2 (rounding moves a pixel by less than 1e-3).
/// @throws std::invalid_argument when the distortion has no inverse somewhere in the picture; `name` says whose.
[[nodiscard]] cv::Mat RaysOfPixels(const Optics& optics, const std::string& name);

}  // namespace granary
