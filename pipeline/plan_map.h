// The bin seen from above: metres on the floor to pixels of a map, and the bin's shapes drawn there.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "pipeline/plot.h"
#include "pipeline/types/bin.h"

namespace granary {

/// World xy to pixels; x to the right, y up.
struct PlanMap {
  double px_per_m = 1, x0_m = 0, y1_m = 0;
  cv::Size size;
  [[nodiscard]] Eigen::Vector2d Pixel(const Eigen::Vector2d& world) const {
    return {(world.x() - x0_m) * px_per_m, (y1_m - world.y()) * px_per_m};
  }
  [[nodiscard]] PlotAxis XAxis() const { return {x0_m, x0_m + size.width / px_per_m, "x [m]"}; }
  [[nodiscard]] PlotAxis YAxis() const { return {y1_m - size.height / px_per_m, y1_m, "y [m]"}; }
};

/// A map whose longer side of the footprint takes 900 px, and `margin_px` around it.
/// @throws std::invalid_argument when the footprint has no corners
[[nodiscard]] PlanMap FitPlan(const Polygon& footprint_m, int margin_px);

/// CV_8UC1 of the map's size, 255 inside the polygon and on its border.
[[nodiscard]] cv::Mat PolygonMask(const Polygon& polygon_m, const PlanMap& map);

void OutlinePolygon(cv::Mat& picture, const Polygon& polygon_m, const PlanMap& map, int thickness_px);

/// Covers the polygon with grey diagonals and outlines it.
void HatchPolygon(cv::Mat& picture, const Polygon& polygon_m, const PlanMap& map);

}  // namespace granary
