// Completion comes before triangulation: every gap and the footprint's edges get vertices of their own, so that the
// triangulation reaches the walls and no triangle has to bridge.
#include "pipeline/surface.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "pipeline/delaunay.h"
#include "pipeline/local_planes.h"
#include "pipeline/volume.h"

namespace granary {

namespace {

constexpr double kCompletionSpacings = 2;  // distance of completed vertices, in point spacings
constexpr double kPlaneCellSpacings = 5;   // pooling cell of the local planes
constexpr double kMaxSlope = 1.0;          // 45°: steeper than any grain lies

// Which cells of a square grid hold a measured point.
class Occupancy {
 public:
  Occupancy(std::span<const Eigen::Vector3d> points, const Bin& bin, double cell_m) : cell_m_(cell_m) {
    const Eigen::AlignedBox2d box = Bounds(bin.footprint_m);
    low_ = box.min();
    columns_ = static_cast<int>(std::ceil(box.sizes().x() / cell_m)) + 1;
    rows_ = static_cast<int>(std::ceil(box.sizes().y() / cell_m)) + 1;
    cells_.assign(static_cast<std::size_t>(columns_) * rows_, 0);
    for (const auto& p : points) {
      const int i = static_cast<int>((p.x() - low_.x()) / cell_m), j = static_cast<int>((p.y() - low_.y()) / cell_m);
      if (i >= 0 && i < columns_ && j >= 0 && j < rows_) cells_[static_cast<std::size_t>(j) * columns_ + i] = 1;
    }
  }
  /// True when the 3×3 cells around (column, row) are empty.
  [[nodiscard]] bool EmptyAround(int column, int row) const {
    for (int j = std::max(0, row - 1); j <= std::min(rows_ - 1, row + 1); ++j) {
      for (int i = std::max(0, column - 1); i <= std::min(columns_ - 1, column + 1); ++i) {
        if (cells_[static_cast<std::size_t>(j) * columns_ + i]) return false;
      }
    }
    return true;
  }
  [[nodiscard]] Eigen::Vector2d Centre(int column, int row) const {
    return low_ + Eigen::Vector2d(column + 0.5, row + 0.5) * cell_m_;
  }
  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }

 private:
  double cell_m_;
  Eigen::Vector2d low_;
  int columns_ = 0, rows_ = 0;
  std::vector<char> cells_;
};

void AppendEdge(const Polygon& polygon, double step_m, std::vector<Eigen::Vector2d>& places) {
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d a = polygon[i], b = polygon[(i + 1) % polygon.size()];
    const int steps = std::max(1, static_cast<int>(std::ceil((b - a).norm() / step_m)));
    for (int k = 0; k < steps; ++k) places.push_back(a + (b - a) * (static_cast<double>(k) / steps));
  }
}

// Where vertices have to be made up: along every edge, and wherever no measured point is near.
std::vector<Eigen::Vector2d> PlacesToComplete(std::span<const Eigen::Vector3d> measured, const Bin& bin,
                                              double step_m) {
  std::vector<Eigen::Vector2d> places;
  AppendEdge(bin.footprint_m, step_m, places);
  for (const auto& hole : bin.exclude_m) AppendEdge(hole, step_m, places);
  const Occupancy occupancy(measured, bin, step_m);
  for (int j = 0; j < occupancy.rows(); ++j) {
    for (int i = 0; i < occupancy.columns(); ++i) {
      if (!occupancy.EmptyAround(i, j)) continue;
      const Eigen::Vector2d place = occupancy.Centre(i, j);
      // Not within half a step of an edge, which has vertices of its own.
      if (IsGrainFloor(bin, place) && DistanceToEdge_m(bin, place) > step_m / 2) places.push_back(place);
    }
  }
  return places;
}

}  // namespace

Surface BuildSurface(std::span<const Eigen::Vector3d> measured, const Floor& floor, const Bin& bin, double spacing_m,
                     std::optional<double> edge_threshold_m) {
  if (!(spacing_m > 0)) throw std::invalid_argument("surface: the point spacing must be larger than 0");
  Surface surface;
  surface.point_spacing_m = spacing_m;
  surface.edge_threshold_m = edge_threshold_m.value_or(kEdgeSpacings * spacing_m);
  if (measured.empty()) return surface;

  const auto places = PlacesToComplete(measured, bin, kCompletionSpacings * spacing_m);
  const LocalPlanes planes(measured, kPlaneCellSpacings * spacing_m);
  const std::size_t total = measured.size() + places.size();
  surface.vertices_in_world.assign(measured.begin(), measured.end());
  surface.vertices_in_world.resize(total);
  surface.interpolated.assign(total, 0);
  std::fill(surface.interpolated.begin() + static_cast<std::ptrdiff_t>(measured.size()), surface.interpolated.end(), 1);
  surface.height_m.resize(total);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, total, 4096), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      Eigen::Vector3d& vertex = surface.vertices_in_world[i];
      if (i >= measured.size()) {
        const Eigen::Vector2d& place = places[i - measured.size()];
        vertex << place, std::min(planes.HeightAt(place, kMaxSlope).value(), bin.height_m);
      }
      surface.height_m[i] = vertex.z() - floor.HeightAt(vertex.head<2>());
    }
  });

  std::vector<Eigen::Vector2d> plan(total);
  std::transform(surface.vertices_in_world.begin(), surface.vertices_in_world.end(), plan.begin(),
                 [](const Eigen::Vector3d& v) { return Eigen::Vector2d(v.head<2>()); });
  const double limit_m = surface.edge_threshold_m;
  for (const auto& t : TriangulateDelaunay(plan)) {
    const Eigen::Vector2d &a = plan[t[0]], &b = plan[t[1]], &c = plan[t[2]];
    const double longest = std::max({(a - b).squaredNorm(), (b - c).squaredNorm(), (c - a).squaredNorm()});
    const bool completed = surface.interpolated[t[0]] || surface.interpolated[t[1]] || surface.interpolated[t[2]];
    // A triangle of measured points alone lies between points on the grain floor, away from every edge.
    if (completed && !IsGrainFloor(bin, (a + b + c) / 3)) continue;
    if (longest > limit_m * limit_m) {
      surface.too_long.push_back(t);
      continue;
    }
    surface.triangles.push_back(t);
    surface.triangle_interpolated.push_back(completed ? 1 : 0);
  }
  return surface;
}

}  // namespace granary
