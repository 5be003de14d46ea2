// How long an edge of the surface may be: a multiple of the distance of neighbouring points where it lies.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace granary {

/// Automatic edge limit as a multiple of the point spacing. Points a pixel apart give edges of 1 to 1.5 spacings;
/// completion fills every gap wider than about 5.
inline constexpr double kEdgeSpacings = 8;

/// Distances of neighbouring points on the floor plane, place by place: nearer to the cameras points lie closer.
/// Immutable after construction.
class LocalSpacing {
 public:
  /// The median edge of the triangles in each square of the floor; a square with few of them has the median of all.
  /// @param plan points on the floor plane, metres
  /// @param triangles of measured points, or an even part of them
  /// @param typical_m rough spacing: sets the side of the squares, and stands where there are no triangles at all
  LocalSpacing(std::span<const Eigen::Vector2d> plan, std::span<const std::array<std::uint32_t, 3>> triangles,
               double typical_m);

  /// metres, above 0
  [[nodiscard]] double At(const Eigen::Vector2d& place) const;
  [[nodiscard]] double Median_m() const { return median_m_; }

 private:
  Eigen::Vector2d origin_{0, 0};
  double cell_m_ = 1, median_m_ = 0;
  int columns_ = 0, rows_ = 0;
  std::vector<double> spacing_m_;
};

/// Square of the longest edge of a triangle on the floor plane, m².
[[nodiscard]] inline double LongestEdgeSquared(const Eigen::Vector2d& a, const Eigen::Vector2d& b,
                                               const Eigen::Vector2d& c) {
  return std::max({(a - b).squaredNorm(), (b - c).squaredNorm(), (c - a).squaredNorm()});
}

}  // namespace granary
