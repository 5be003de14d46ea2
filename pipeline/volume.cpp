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
  CompensatedSum measured, interpolated, measured_area, interpolated_area, level;
  double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
  for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
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
    (completed ? interpolated : measured).Add(volume);
    (completed ? interpolated_area : measured_area).Add(area);
    level.Add(level_volume);
    lowest = std::min({lowest, a.z(), b.z(), c.z()});
    highest = std::max({highest, a.z(), b.z(), c.z()});
  }
  VolumeResult result;
  result.measured_m3 = measured.Value();
  result.interpolated_m3 = interpolated.Value();
  result.total_m3 = result.measured_m3 + result.interpolated_m3;
  result.measured_area_m2 = measured_area.Value();
  result.area_m2 = result.measured_area_m2 + interpolated_area.Value();
  if (!surface.triangles.empty()) {
    result.level_min_m = lowest;
    result.level_max_m = highest;
  }
  if (result.area_m2 > 0) {
    result.height_mean_m = result.total_m3 / result.area_m2;
    result.level_mean_m = level.Value() / result.area_m2;
  }
  return result;
}

std::optional<double> MedianSpacing_m(std::span<const Eigen::Vector2d> points, std::span<const Triangle> triangles) {
  if (triangles.empty()) return std::nullopt;
  constexpr std::size_t kSample = 100'000;
  const std::size_t step = std::max<std::size_t>(1, triangles.size() / kSample);
  std::vector<double> squared;
  squared.reserve(3 * (triangles.size() / step + 1));
  for (std::size_t i = 0; i < triangles.size(); i += step) {
    const auto& [a, b, c] = triangles[i];
    squared.push_back((points[b] - points[a]).squaredNorm());
    squared.push_back((points[c] - points[b]).squaredNorm());
    squared.push_back((points[a] - points[c]).squaredNorm());
  }
  const auto middle = squared.begin() + static_cast<std::ptrdiff_t>(squared.size() / 2);
  std::nth_element(squared.begin(), middle, squared.end());
  return std::sqrt(*middle);
}

}  // namespace granary
