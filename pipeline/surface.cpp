// Completion comes before triangulation: every gap and the footprint's edges get vertices of their own, so that the
// triangulation reaches the walls and no triangle has to bridge.
#include "pipeline/surface.h"

#include <algorithm>
#include <stdexcept>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "pipeline/completion.h"
#include "pipeline/delaunay.h"
#include "pipeline/edge_limit.h"
#include "pipeline/large_pages.h"
#include "pipeline/local_planes.h"

namespace granary {

namespace {

constexpr double kCompletionSpacings = 2;        // distance of completed vertices, in point spacings
constexpr double kPlaneCellSpacings = 5;         // pooling cell of the local planes
constexpr std::size_t kManyTriangles = 400'000;  // of which every fourth says how far apart points are

using Triangle = std::array<std::uint32_t, 3>;

// What becomes of a triangle.
enum class Fate : std::uint8_t { kOffTheFloor, kTooLong, kMeasured, kCompleted };

// Sorts the triangles on the grain floor into those within the limit and those beyond.
void LimitEdges(std::span<const Eigen::Vector2d> plan, const std::vector<Triangle>& triangles, const Bin& bin,
                std::optional<double> fixed_m, Surface& surface) {
  const auto completed = [&](const Triangle& t) {
    return surface.interpolated[t[0]] || surface.interpolated[t[1]] || surface.interpolated[t[2]];
  };
  std::optional<LocalSpacing> spacing;
  if (!fixed_m) {
    const std::size_t step = triangles.size() > kManyTriangles ? 4 : 1;
    auto some = ReserveLarge<Triangle>(triangles.size() / step + 1);
    for (std::size_t i = 0; i < triangles.size(); i += step) {
      if (!completed(triangles[i])) some.push_back(triangles[i]);
    }
    spacing.emplace(plan, some, surface.point_spacing_m);
  }
  surface.edge_threshold_m = fixed_m ? *fixed_m : kEdgeSpacings * spacing->Median_m();

  auto fates = MakeLarge<Fate>(triangles.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, triangles.size(), 8192), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const Triangle& t = triangles[i];
      const Eigen::Vector2d &a = plan[t[0]], &b = plan[t[1]], &c = plan[t[2]];
      const bool made_up = completed(t);
      // A triangle of measured points alone lies between points on the grain floor, away from every edge.
      if (made_up && !IsGrainFloor(bin, (a + b + c) / 3)) continue;
      // Completed vertices lie as far apart everywhere.
      double limit_m = surface.edge_threshold_m;
      if (!fixed_m) limit_m = kEdgeSpacings * (made_up ? surface.point_spacing_m : spacing->At(a));
      const bool too_long = LongestEdgeSquared(a, b, c) > limit_m * limit_m;
      fates[i] = too_long ? Fate::kTooLong : made_up ? Fate::kCompleted : Fate::kMeasured;
    }
  });
  surface.triangles = ReserveLarge<Triangle>(triangles.size());
  surface.triangle_interpolated = ReserveLarge<std::uint8_t>(triangles.size());
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    if (fates[i] == Fate::kTooLong) surface.too_long.push_back(triangles[i]);
    if (fates[i] != Fate::kMeasured && fates[i] != Fate::kCompleted) continue;
    surface.triangles.push_back(triangles[i]);
    surface.triangle_interpolated.push_back(fates[i] == Fate::kCompleted ? 1 : 0);
  }
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
  const double max_slope = SteepestSlope(bin);
  surface.completion_deviation_m = CompletionDeviation_m(planes, places, max_slope);
  const std::size_t total = measured.size() + places.size();
  surface.vertices_in_world = ReserveLarge<Eigen::Vector3d>(total);
  surface.vertices_in_world.assign(measured.begin(), measured.end());
  surface.vertices_in_world.resize(total);
  surface.interpolated.assign(total, 0);
  std::fill(surface.interpolated.begin() + static_cast<std::ptrdiff_t>(measured.size()), surface.interpolated.end(), 1);
  surface.height_m = MakeLarge<double>(total);
  auto plan = MakeLarge<Eigen::Vector2d>(total);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, total, 4096), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      Eigen::Vector3d& vertex = surface.vertices_in_world[i];
      if (i >= measured.size()) {
        const Eigen::Vector2d& place = places[i - measured.size()];
        vertex << place, std::min(planes.HeightAt(place, max_slope).value(), bin.height_m);
      }
      plan[i] = vertex.head<2>();
      surface.height_m[i] = vertex.z() - floor.HeightAt(vertex.head<2>());
    }
  });

  LimitEdges(plan, TriangulateDelaunay(plan), bin, edge_threshold_m, surface);
  return surface;
}

}  // namespace granary
