// A picture with a title, axes and a colour bar around it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

namespace granary {

/// One axis of a picture: `at_start` is the value at its left or bottom edge, `at_end` at its right or top edge.
struct PlotAxis {
  double at_start = 0, at_end = 1;
  std::string label;  ///< with the unit, e.g. "x [m]"
};

struct ColourBar {
  double low = 0, high = 1;
  std::string label;   ///< with the unit
  int colour_map = 0;  ///< cv::ColormapTypes
};

/// Round values (1, 2 or 5 times a power of ten apart), about `count` of them, inside [low, high] in ascending order.
[[nodiscard]] std::vector<double> RoundTicks(double low, double high, int count);

/// The colour of `values` (CV_32FC1) on the bar; not finite: light grey. @return CV_8UC3, BGR
[[nodiscard]] cv::Mat Colourise(const cv::Mat& values, const ColourBar& bar);

/// Writes `text` centred on `centre`; ASCII only.
void DrawCentredText(cv::Mat& picture, const std::string& text, cv::Point centre, const cv::Scalar& colour);

/// `body` (CV_8UC3) on white with what is given drawn around it.
[[nodiscard]] cv::Mat FramePlot(const cv::Mat& body, const std::string& title, const std::optional<PlotAxis>& x,
                                const std::optional<PlotAxis>& y, const std::optional<ColourBar>& bar);

}  // namespace granary
