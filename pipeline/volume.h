// From a triangulated surface to a volume.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "pipeline/surface.h"

namespace granary {

/// Area of a triangle on the floor plane, m²; positive when it is counter-clockwise.
[[nodiscard]] double PlanArea_m2(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c);

/// Volume between a triangle of floor area `area_m2` and the surface over it whose heights at the corners are given:
/// S · (hA + hB + hC) / 3, m³. Negative heights count negative. Source: METHOD §6.
[[nodiscard]] double PrismVolume_m3(double area_m2, double height_a_m, double height_b_m, double height_c_m);

/// The same volume as the paper builds it, by cut and complement: a right prism as high as the lowest corner, a
/// pyramid on a quadrangle and a tetrahedron on what stands above it, each as ⅓ · base · height, m³.
/// @param a, b, c corners of the triangle; x and y on the floor, z the height over it, metres; any winding
/// Source: Zhao 2023, §6.2, `V = S·h1 + ⅓·S_BB2C2C3·h2 + ⅓·S_BCC3·h3`.
[[nodiscard]] double CutAndComplementVolume_m3(const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                               const Eigen::Vector3d& c);

/// What lies under a surface. Levels are z of the vertices that triangles use, empty where there is no triangle.
struct VolumeResult {
  double total_m3 = 0;         ///< measured + interpolated
  double measured_m3 = 0;      ///< under triangles of measured points only
  double interpolated_m3 = 0;  ///< under triangles with a completed point
  double area_m2 = 0;          ///< floor area under all triangles
  double measured_area_m2 = 0;
  std::optional<double> height_mean_m;  ///< volume over area: mean height over the floor under the grain
  std::optional<double> level_mean_m;   ///< mean over the area
  std::optional<double> level_min_m, level_max_m;
};

/// Sums the prisms under all triangles of `surface`. The sums are compensated, so that millions of small prisms lose no
/// digits, and do not depend on the number of threads.
/// @throws std::invalid_argument when the arrays do not fit together, a triangle names a vertex that does not exist or
///   is clockwise seen from above, or one of its heights is not finite; names the triangle
[[nodiscard]] VolumeResult IntegrateVolume(const Surface& surface);

}  // namespace granary
