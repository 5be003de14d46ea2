// Node heights are local planes through the reference's floor points; between nodes, bilinear.
#include "pipeline/floor.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "pipeline/local_planes.h"
#include "pipeline/segment.h"

namespace granary {

namespace {

constexpr double kMaxFloorSlope = 0.3;

}  // namespace

double DistanceToEdge_m(const Bin& bin, const Eigen::Vector2d& place) {
  double nearest = DistanceToBorder_m(bin.footprint_m, place);
  for (const auto& hole : bin.exclude_m) nearest = std::min(nearest, DistanceToBorder_m(hole, place));
  return nearest;
}

bool IsGrainFloor(const Bin& bin, const Eigen::Vector2d& place) {
  return Contains(bin.footprint_m, place) && std::none_of(bin.exclude_m.begin(), bin.exclude_m.end(),
                                                          [&](const Polygon& hole) { return Contains(hole, place); });
}

Floor::Floor(std::span<const Eigen::Vector3d> points, const Bin& bin, double cell_m, double tolerance_m,
             double margin_m)
    : cell_m_(cell_m) {
  std::vector<Eigen::Vector3f> inside;
  for (const auto& p : points) {
    if (p.allFinite() && p.z() < bin.height_m / 2 && IsGrainFloor(bin, p.head<2>()) &&
        DistanceToEdge_m(bin, p.head<2>()) > margin_m) {
      inside.push_back(p.cast<float>());
    }
  }
  const auto plane = FitFloorPlane(inside, static_cast<float>(tolerance_m));
  if (!plane) {
    throw std::invalid_argument("no level floor was found in the points of the empty bin (" +
                                std::to_string(inside.size()) + " points inside the footprint)");
  }
  std::vector<Eigen::Vector3d> floor_points;
  for (const auto& p : inside) {
    const Eigen::Vector3d point = p.cast<double>();
    const double off = plane->coefficients.head<3>().dot(point) + plane->coefficients(3);
    if (std::abs(off) <= tolerance_m) floor_points.push_back(point);
  }
  const LocalPlanes planes(floor_points, cell_m);
  const Eigen::AlignedBox2d box = Bounds(bin.footprint_m);
  origin_ = box.min();
  columns_ = static_cast<int>(std::ceil(box.sizes().x() / cell_m)) + 1;
  rows_ = static_cast<int>(std::ceil(box.sizes().y() / cell_m)) + 1;
  nodes_.resize(static_cast<std::size_t>(columns_) * rows_);
  for (int j = 0; j < rows_; ++j) {
    for (int i = 0; i < columns_; ++i) {
      nodes_[static_cast<std::size_t>(j) * columns_ + i] =
          planes.HeightAt(origin_ + Eigen::Vector2d(i, j) * cell_m, kMaxFloorSlope).value();
    }
  }
  // Share of cells, of those on the grain floor, that hold a floor point.
  std::vector<char> seen(nodes_.size(), 0);
  for (const auto& p : floor_points) {
    const int i = static_cast<int>((p.x() - origin_.x()) / cell_m),
              j = static_cast<int>((p.y() - origin_.y()) / cell_m);
    seen[static_cast<std::size_t>(j) * columns_ + i] = 1;
  }
  double on_floor = 0, with_points = 0;
  for (int j = 0; j + 1 < rows_; ++j) {
    for (int i = 0; i + 1 < columns_; ++i) {
      const Eigen::Vector2d centre = origin_ + Eigen::Vector2d(i + 0.5, j + 0.5) * cell_m;
      if (!IsGrainFloor(bin, centre) || DistanceToEdge_m(bin, centre) <= margin_m) continue;
      ++on_floor;
      with_points += seen[static_cast<std::size_t>(j) * columns_ + i];
    }
  }
  seen_share_ = on_floor > 0 ? with_points / on_floor : 0;
}

double Floor::HeightAt(const Eigen::Vector2d& place) const {
  if (nodes_.empty()) return 0;
  const double u = std::clamp((place.x() - origin_.x()) / cell_m_, 0.0, static_cast<double>(columns_ - 1));
  const double v = std::clamp((place.y() - origin_.y()) / cell_m_, 0.0, static_cast<double>(rows_ - 1));
  const int i = std::min(columns_ - 2, static_cast<int>(u)), j = std::min(rows_ - 2, static_cast<int>(v));
  const double s = u - i, t = v - j;
  const auto node = [&](int column, int row) { return nodes_[static_cast<std::size_t>(row) * columns_ + column]; };
  return (1 - t) * ((1 - s) * node(i, j) + s * node(i + 1, j)) +
         t * ((1 - s) * node(i, j + 1) + s * node(i + 1, j + 1));
}

}  // namespace granary
