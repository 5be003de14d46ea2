// The volume is a sum of prisms (METHOD §6), each in closed form; a compensated sum keeps what plain addition of
// millions of small terms to a large one would round away.
#include "pipeline/volume.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <tbb/parallel_for.h>

#include "pipeline/compensated_sum.h"

namespace granary {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

void CheckArrays(const Surface& surface) {
  const std::size_t vertices = surface.vertices_in_world.size(), triangles = surface.triangles.size();
  if (surface.height_m.size() != vertices) {
    throw std::invalid_argument("IntegrateVolume: " + std::to_string(vertices) + " vertices but " +
                                std::to_string(surface.height_m.size()) + " heights");
  }
  if (surface.triangle_interpolated.size() != triangles) {
    throw std::invalid_argument("IntegrateVolume: " + std::to_string(triangles) + " triangles but " +
                                std::to_string(surface.triangle_interpolated.size()) + " flags of interpolation");
  }
}

struct Sums {
  CompensatedSum measured, interpolated, measured_area, interpolated_area, level;
  double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
};

void AddTriangle(const Surface& surface, std::size_t i, Sums& sums) {
  const Triangle& t = surface.triangles[i];
  const auto fail = [i](const char* what) {
    throw std::invalid_argument("IntegrateVolume: triangle " + std::to_string(i) + " " + what);
  };
  if (*std::max_element(t.begin(), t.end()) >= surface.vertices_in_world.size()) fail("names a missing vertex");
  const Eigen::Vector3d &a = surface.vertices_in_world[t[0]], &b = surface.vertices_in_world[t[1]],
                        &c = surface.vertices_in_world[t[2]];
  const double area = PlanArea_m2(a.head<2>(), b.head<2>(), c.head<2>());
  const double volume = PrismVolume_m3(area, surface.height_m[t[0]], surface.height_m[t[1]], surface.height_m[t[2]]);
  const double level_volume = PrismVolume_m3(area, a.z(), b.z(), c.z());
  if (!std::isfinite(volume) || !std::isfinite(level_volume)) fail("has a corner that is not finite");
  // A sliver's area may round to just below zero; a triangle that was wound the wrong way is far from it.
  const double size2 = std::max((b - a).head<2>().squaredNorm(), (c - a).head<2>().squaredNorm());
  if (area < -1e-9 * size2) fail("is clockwise seen from above");
  const bool completed = surface.triangle_interpolated[i] != 0;
  (completed ? sums.interpolated : sums.measured).Add(volume);
  (completed ? sums.interpolated_area : sums.measured_area).Add(area);
  sums.level.Add(level_volume);
  sums.lowest = std::min({sums.lowest, a.z(), b.z(), c.z()});
  sums.highest = std::max({sums.highest, a.z(), b.z(), c.z()});
}

}  // namespace

double PlanArea_m2(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  const Eigen::Vector2d ab = b - a, ac = c - a;
  return (ab.x() * ac.y() - ab.y() * ac.x()) / 2;
}

double PrismVolume_m3(double area_m2, double height_a_m, double height_b_m, double height_c_m) {
  return area_m2 * (height_a_m + height_b_m + height_c_m) / 3;
}

double CutAndComplementVolume_m3(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  std::array<Eigen::Vector3d, 3> corner{a, b, c};
  std::sort(corner.begin(), corner.end(), [](const auto& p, const auto& q) { return p.z() < q.z(); });
  const auto& [low, middle, high] = corner;
  const Eigen::Vector2d low_xy = low.head<2>(), middle_xy = middle.head<2>(), high_xy = high.head<2>();
  const double area = std::abs(PlanArea_m2(low_xy, middle_xy, high_xy));
  // The right prism reaches up to the lowest corner.
  const double prism = area * low.z();
  // A cut at the middle corner's height leaves below it a pyramid: its apex is the lowest corner, its base the upright
  // rectangle over the opposite side.
  const double side = (high_xy - middle_xy).norm();
  const double rectangle = side * (middle.z() - low.z());
  const double to_side = side > 0 ? 2 * area / side : 0;
  const double pyramid = rectangle * to_side / 3;
  // Above the cut a tetrahedron remains: base the triangle itself, apex the highest corner.
  const double tetrahedron = area * (high.z() - middle.z()) / 3;
  return prism + pyramid + tetrahedron;
}

VolumeResult IntegrateVolume(const Surface& surface) {
  CheckArrays(surface);
  // Parts of a fixed size, added in order: the sum is the same however many threads there are.
  constexpr std::size_t kPart = 1 << 16;
  std::vector<Sums> parts((surface.triangles.size() + kPart - 1) / kPart);
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t part) {
    const std::size_t end = std::min(surface.triangles.size(), (part + 1) * kPart);
    for (std::size_t i = part * kPart; i < end; ++i) AddTriangle(surface, i, parts[part]);
  });
  Sums all;
  for (const Sums& part : parts) {
    all.measured.Add(part.measured.Value());
    all.interpolated.Add(part.interpolated.Value());
    all.measured_area.Add(part.measured_area.Value());
    all.interpolated_area.Add(part.interpolated_area.Value());
    all.level.Add(part.level.Value());
    all.lowest = std::min(all.lowest, part.lowest);
    all.highest = std::max(all.highest, part.highest);
  }
  VolumeResult result;
  result.measured_m3 = all.measured.Value();
  result.interpolated_m3 = all.interpolated.Value();
  result.total_m3 = result.measured_m3 + result.interpolated_m3;
  result.measured_area_m2 = all.measured_area.Value();
  result.area_m2 = result.measured_area_m2 + all.interpolated_area.Value();
  if (!surface.triangles.empty()) {
    result.level_min_m = all.lowest;
    result.level_max_m = all.highest;
  }
  if (result.area_m2 > 0) {
    result.height_mean_m = result.total_m3 / result.area_m2;
    result.level_mean_m = all.level.Value() / result.area_m2;
  }
  return result;
}

}  // namespace granary
