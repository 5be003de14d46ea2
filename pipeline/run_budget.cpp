// Deviations of single pixels come from the matcher, those of a whole rig from what its calibration is known to.
#include "pipeline/run_budget.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>

namespace granary {

namespace {

constexpr double kUnknownRig = 0.01;  // of the volume, where calibration and pose cannot be judged

// Neighbouring disparities share their window's noise.
double CorrelatedPixels(const StereoOptions& stereo) {
  if (stereo.refine_radius_px == 0) return stereo.census_width * stereo.census_height;
  const double side = 2 * stereo.refine_radius_px + 1;
  return side * side;
}

// A pose is found by the pictures that the calibration explains, so that their errors go together.
RigDeviation DeviationOf(const RigGeometry& rig, const std::vector<SurfaceSample>& samples, FloorSource floor,
                         double volume_m3) {
  try {
    return VolumeDeviation(samples, rig.setup.calibration, rig.setup.world_from_left, floor,
                           PoseOrigin::kFoundWithCalibration);
  } catch (const std::invalid_argument&) {  // so little was seen that no sample lies in both pictures
    return {kUnknownRig * std::abs(volume_m3), 0};
  }
}

}  // namespace

CloudNoise NoiseOfReference(const Reference& reference, const RigGeometry& rig, const StereoOptions& stereo) {
  CloudNoise noise;
  double squares = 0;
  for (int y = 0; y < reference.noise_m.rows; ++y) {
    for (int x = 0; x < reference.noise_m.cols; ++x) {
      const double height_m = reference.noise_m.at<float>(y, x);
      if (rig.left_mask.at<std::uint8_t>(y, x) == 0 || !std::isfinite(height_m)) continue;
      squares += height_m * height_m;
      noise.points += 1;
    }
  }
  if (noise.points > 0) noise.height_m = std::sqrt(squares / noise.points);
  noise.correlated_px = CorrelatedPixels(stereo);
  noise.depth_step_m = rig.floor_step_m;
  return noise;
}

CloudNoise NoiseOfGrain(const std::vector<RigView>& views, const std::vector<RigGeometry>& rigs,
                        const StereoOptions& stereo, double distance_m) {
  CloudNoise noise;
  double squares = 0, stated = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Rectification& r = rigs[i].rectification;
    noise.depth_step_m = std::max(noise.depth_step_m, r.DepthStep_m(std::max(0.01, distance_m)));
    const RigView& view = views[i];
    for (int y = 0; y < view.grain_mask.rows; ++y) {
      for (int x = 0; x < view.grain_mask.cols; ++x) {
        if (!view.grain_mask.at<std::uint8_t>(y, x)) continue;
        noise.points += 1;
        const float deviation = view.deviation_px.at<float>(y, x);
        if (!std::isfinite(deviation)) continue;
        const double height_m = r.DepthStep_m(r.Depth_m(view.disparity_px.at<float>(y, x))) * deviation;
        squares += height_m * height_m;
        stated += 1;
      }
    }
  }
  if (stated > 0) noise.height_m = std::sqrt(squares / stated);
  noise.correlated_px = CorrelatedPixels(stereo);
  return noise;
}

RigDeviation DeviationOfRigs(const std::vector<RigGeometry>& rigs, const std::vector<SurfaceSample>& samples,
                             FloorSource floor, double volume_m3) {
  const double share = 1.0 / static_cast<double>(rigs.size());
  RigDeviation all;
  for (const RigGeometry& rig : rigs) {
    const RigDeviation one = DeviationOf(rig, samples, floor, volume_m3);
    all.calibration_m3 = std::hypot(all.calibration_m3, share * one.calibration_m3);
    all.pose_m3 = std::hypot(all.pose_m3, share * one.pose_m3);
  }
  return all;
}

}  // namespace granary
