#include "pipeline/types/bin.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace granary {

double Area_m2(const Polygon& polygon) {
  double twice = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const auto& a = polygon[i];
    const auto& b = polygon[(i + 1) % polygon.size()];
    twice += a.x() * b.y() - b.x() * a.y();
  }
  return std::abs(twice) / 2;
}

Eigen::AlignedBox2d Bounds(const Polygon& polygon) {
  Eigen::AlignedBox2d box;
  for (const auto& corner : polygon) box.extend(corner);
  return box;
}

double DistanceToBorder_m(const Polygon& polygon, const Eigen::Vector2d& point) {
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d a = polygon[i], ab = polygon[(i + 1) % polygon.size()] - a;
    const double along = std::clamp((point - a).dot(ab) / ab.squaredNorm(), 0.0, 1.0);
    nearest = std::min(nearest, (point - a - along * ab).norm());
  }
  return nearest;
}

double GrainFloor_m2(const Bin& bin) {
  double area_m2 = Area_m2(bin.footprint_m);
  for (const auto& hole : bin.exclude_m) area_m2 -= Area_m2(hole);
  return area_m2;
}

double Capacity_m3(const Bin& bin) { return GrainFloor_m2(bin) * bin.height_m; }

bool Contains(const Polygon& polygon, const Eigen::Vector2d& point) {
  bool inside = false;
  for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++) {
    const auto& a = polygon[i];
    const auto& b = polygon[j];
    const Eigen::Vector2d ab = b - a, ap = point - a;
    const double cross = ab.x() * ap.y() - ab.y() * ap.x();
    const double along = ab.dot(ap);
    if (cross == 0 && along >= 0 && along <= ab.squaredNorm()) return true;  // on the edge
    if ((a.y() > point.y()) != (b.y() > point.y()) &&
        point.x() < (b.x() - a.x()) * (point.y() - a.y()) / (b.y() - a.y()) + a.x()) {
      inside = !inside;
    }
  }
  return inside;
}

}  // namespace granary
