// Where nothing was seen: the places that need a made-up height, and how far such heights are off.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "pipeline/local_planes.h"
#include "pipeline/types/bin.h"

namespace granary {

/// Places on the floor plane, metres: along every edge of the footprint and the excluded polygons, and wherever on the
/// grain floor no measured point is near.
/// @param step_m distance between them
[[nodiscard]] std::vector<Eigen::Vector2d> PlacesToComplete(std::span<const Eigen::Vector3d> measured_in_world,
                                                            const Bin& bin, double step_m);

/// Steepest slope of a made-up surface, as a tangent: the angle of repose, or 45° where it is not known.
[[nodiscard]] double SteepestSlope(const Bin& bin);

/// Standard deviation of the mean of the made-up heights, m. The made-up strip is mirrored into the measured surface:
/// as far on the other side of the seam, places that were measured are predicted from what lies at least as far beyond
/// them, and the differences show what the same rule does to the real strip, its lean to one side and its scatter.
/// @return empty when too few places can be mirrored
[[nodiscard]] std::optional<double> CompletionDeviation_m(const LocalPlanes& planes,
                                                          std::span<const Eigen::Vector2d> places, double max_slope);

}  // namespace granary
