// Delaunay triangulation over the floor plane.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace granary {

/// The Delaunay triangulation of `points`: no point lies strictly inside the circumcircle of any triangle, decided by
/// exact arithmetic on the very coordinates given. Any order of the points will do; picture order is no worse.
///
/// Of points with equal coordinates the first is used and the others appear in no triangle. Fewer than three distinct
/// points, or points that are all on one line, make no triangle. Where four or more points lie on one empty circle
/// any of their triangulations is Delaunay; which one is returned depends on the points alone, so that the result is
/// the same on every run.
///
/// Source: incremental insertion with edge flips (Lawson 1977) along a Hilbert curve; METHOD §6, Zhao 2023, §6.
/// @param points floor coordinates, any unit, at most 2^28; coordinates within 1e-40 of 0 count as 0
/// @return triangles of indices into `points`, each counter-clockwise, the whole convex hull covered
/// @throws std::invalid_argument for a coordinate that is NaN, infinite or beyond ±1e60, naming the point's index, and
///   for too many points
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> TriangulateDelaunay(std::span<const Eigen::Vector2d> points);

}  // namespace granary
