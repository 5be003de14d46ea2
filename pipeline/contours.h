// Lines of equal height in a map.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>

namespace granary {

/// Pixels; whole numbers are pixel centres. A closed line does not repeat its first point.
struct ContourLine {
  std::vector<cv::Point2f> points_px;
  bool closed = false;
};

/// Where `values` crosses `level`, by marching squares; where a value is not finite, lines end.
/// @param values H×W, CV_32FC1
/// @throws std::invalid_argument for another type
[[nodiscard]] std::vector<ContourLine> TraceContours(const cv::Mat& values, double level);

/// Heights for contour lines.
struct ContourLevels {
  double interval = 0;         ///< 1, 2 or 5 times a power of ten
  std::vector<double> levels;  ///< multiples of it, ascending; empty when [low, high] is no interval wide
};

/// Round levels inside [low, high]: about `count` of them, or fewer, so that an interval is no less than
/// `least_interval`.
[[nodiscard]] ContourLevels ChooseContourLevels(double low, double high, int count, double least_interval);

}  // namespace granary
