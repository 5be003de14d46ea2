// The grain's surface over the footprint: measured points, completed where none were seen.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "pipeline/floor.h"
#include "pipeline/types/bin.h"

namespace granary {

/// A triangulated surface in the world frame. Heights are over the floor under the vertex (the reference's where the
/// floor was seen empty, z = 0 elsewhere).
struct Surface {
  std::vector<Eigen::Vector3d> vertices_in_world;       ///< metres
  std::vector<double> height_m;                         ///< one a vertex
  std::vector<std::uint8_t> interpolated;               ///< one a vertex: 1 where completed, 0 where measured
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< counter-clockwise seen from above
  std::vector<std::uint8_t> triangle_interpolated;      ///< one a triangle: 1 when any vertex was completed
  /// Those on the grain floor that an edge beyond the limit keeps out, so that other limits can be tried.
  std::vector<std::array<std::uint32_t, 3>> too_long;
  double point_spacing_m = 0;   ///< median distance of neighbouring measured points, on the floor plane
  double edge_threshold_m = 0;  ///< limit used; the median where it is local
  /// Standard deviation of the mean of the completed heights; empty when it is not known.
  std::optional<double> completion_deviation_m;
  [[nodiscard]] bool Empty() const { return triangles.empty(); }
};

/// The surface over the whole grain floor of `bin` (METHOD §6): measured points, completed by local planes where none
/// were seen and along every edge of the footprint, triangulated (Delaunay), triangles off the grain floor and those
/// with an edge beyond the limit, as seen from above, left out.
///
/// @param measured_in_world grain and floor points inside the footprint, metres; may be empty
/// @param spacing_m distance of neighbouring points on the floor plane; sets how finely is completed
/// @param edge_threshold_m empty: kEdgeSpacings times the spacing of the points where the edge lies
[[nodiscard]] Surface BuildSurface(std::span<const Eigen::Vector3d> measured_in_world, const Floor& floor,
                                   const Bin& bin, double spacing_m, std::optional<double> edge_threshold_m);

}  // namespace granary
