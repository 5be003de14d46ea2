// What a run and its rigs put into the uncertainty's budget.
#pragma once

#include <vector>

#include "pipeline/options.h"
#include "pipeline/pipeline.h"
#include "pipeline/reference.h"
#include "pipeline/rig_geometry.h"
#include "pipeline/rig_sensitivity.h"
#include "pipeline/uncertainty.h"

namespace granary {

/// Noise of the floor that a reference shows, from its noise map.
[[nodiscard]] CloudNoise NoiseOfReference(const Reference& reference, const RigGeometry& rig,
                                          const StereoOptions& stereo);

/// Noise of the grain's points, from the deviations that the refinement states.
/// @param views one for each of `rigs`, with their grain masks
/// @param distance_m from the cameras to the surface, for the change of depth a pixel
[[nodiscard]] CloudNoise NoiseOfGrain(const std::vector<RigView>& views, const std::vector<RigGeometry>& rigs,
                                      const StereoOptions& stereo, double distance_m);

/// What calibration and pose of all rigs are worth in volume. Rigs are calibrated one by one: their errors are
/// independent, and each has its share of the cloud.
[[nodiscard]] RigDeviation DeviationOfRigs(const std::vector<RigGeometry>& rigs,
                                           const std::vector<SurfaceSample>& samples, FloorSource floor,
                                           double volume_m3);

}  // namespace granary
