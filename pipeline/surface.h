// The grain's surface over the footprint: measured points, completed where none were seen.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace granary {

/// A triangulated surface in the world frame. Heights are over the floor under the vertex (the reference's where the
/// floor was seen empty, z = 0 elsewhere).
struct Surface {
  std::vector<Eigen::Vector3d> vertices_in_world;   ///< metres
  std::vector<double> height_m;                     ///< one a vertex
  std::vector<std::uint8_t> interpolated;           ///< one a vertex: 1 where completed, 0 where measured
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< counter-clockwise seen from above
  std::vector<std::uint8_t> triangle_interpolated;  ///< one a triangle: 1 when any vertex was completed
  double point_spacing_m = 0;                       ///< median distance of neighbouring measured points, on the floor plane
  double edge_threshold_m = 0;                      ///< limit used
  [[nodiscard]] bool Empty() const { return triangles.empty(); }
};

}  // namespace granary
