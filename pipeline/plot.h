// A picture with a title, axes and a colour bar around it.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "pipeline/colours.h"

namespace granary {

inline const cv::Scalar kInk{40, 40, 40};  ///< BGR: lines and text

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

/// The smallest of 1, 2 or 5 times a power of ten that is no less than `rough`, which must be larger than 0.
[[nodiscard]] double RoundStep(double rough);

/// As many decimals as tell values `step` apart: 0.1234 is "0.12" for a step of 0.02.
[[nodiscard]] std::string RoundText(double value, double step);

/// Round values (1, 2 or 5 times a power of ten apart), about `count` of them, inside [low, high] in ascending order.
[[nodiscard]] std::vector<double> RoundTicks(double low, double high, int count);

/// The values below which a share `low` … `high` (0 … 1) of the finite ones lies, so that a few outliers do not eat the
/// colours; 0 and 1 when none is finite, widened when both are one.
[[nodiscard]] std::pair<double, double> FiniteRange(const cv::Mat& values, double low, double high);

/// The colour of `values` (CV_32FC1) on the bar; not finite: light grey. @return CV_8UC3, BGR
[[nodiscard]] cv::Mat Colourise(const cv::Mat& values, const ColourBar& bar);

/// Writes `text` centred on `centre`; ASCII only.
void DrawCentredText(cv::Mat& picture, const std::string& text, cv::Point centre, const cv::Scalar& colour);
/// The size of what DrawCentredText writes, px.
[[nodiscard]] cv::Size TextSize(const std::string& text);

[[nodiscard]] inline cv::Scalar Bgr(const Rgb& colour) {
  return {double(colour[2]), double(colour[1]), double(colour[0])};
}

struct LegendEntry {
  Rgb colour{};
  std::string text;
};
/// `picture` with a line of coloured squares and what they stand for below it; widened on both sides when they need
/// more room.
[[nodiscard]] cv::Mat AppendLegend(const cv::Mat& picture, std::span<const LegendEntry> entries);

/// `body` (CV_8UC3) on white with what is given drawn around it.
[[nodiscard]] cv::Mat FramePlot(const cv::Mat& body, const std::string& title, const std::optional<PlotAxis>& x,
                                const std::optional<PlotAxis>& y, const std::optional<ColourBar>& bar);

}  // namespace granary
