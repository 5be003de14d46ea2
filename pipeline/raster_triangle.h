// A triangle in pixels.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include <Eigen/Core>
#include <opencv2/core/types.hpp>

namespace granary {

/// Calls `paint(pixel, w)` for the pixel centres inside the triangle and the picture, w their barycentric weights
/// (std::array<double, 3>). Pixels on an edge that two triangles share belong to both: no seams.
template <typename Paint>
void RasterTriangle(const std::array<Eigen::Vector2d, 3>& corners_px, cv::Size size, Paint&& paint) {
  const Eigen::Vector2d &a = corners_px[0], &b = corners_px[1], &c = corners_px[2];
  const double area = (b.x() - a.x()) * (c.y() - a.y()) - (c.x() - a.x()) * (b.y() - a.y());
  if (area == 0 || !std::isfinite(area)) return;
  const auto clip = [](double value, int end) { return static_cast<int>(std::clamp(value, 0.0, double(end))); };
  const int left = clip(std::floor(std::min({a.x(), b.x(), c.x()})), size.width);
  const int right = clip(std::ceil(std::max({a.x(), b.x(), c.x()})) + 1, size.width);
  const int top = clip(std::floor(std::min({a.y(), b.y(), c.y()})), size.height);
  const int bottom = clip(std::ceil(std::max({a.y(), b.y(), c.y()})) + 1, size.height);
  constexpr double kEdge = -1e-9;
  for (int y = top; y < bottom; ++y) {
    for (int x = left; x < right; ++x) {
      const double wa = ((b.x() - x) * (c.y() - y) - (c.x() - x) * (b.y() - y)) / area;
      const double wb = ((c.x() - x) * (a.y() - y) - (a.x() - x) * (c.y() - y)) / area;
      const double wc = 1 - wa - wb;
      if (wa >= kEdge && wb >= kEdge && wc >= kEdge) paint(cv::Point(x, y), std::array{wa, wb, wc});
    }
  }
}

}  // namespace granary
