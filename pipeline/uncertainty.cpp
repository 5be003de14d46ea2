// Noise of single points averages away over a million of them; what is common to all of them does not.
#include "pipeline/uncertainty.h"

#include <cmath>

namespace granary {

namespace {

// Common to all points: the largest bias on planes, waves and a real bowl in docs/results.md is 0.002 px.
constexpr double kDisparityBias_px = 0.003;
// An unseen floor is rarely level and at z = 0: share of the camera's height.
constexpr double kUnseenFloor = 1e-3;
// Made-up heights whose error could not be found: share of their volume.
constexpr double kUnknownCompletion = 0.03;

double CloudDeviation_m3(const CloudNoise& cloud, double area_m2) {
  const double bias_m = kDisparityBias_px * cloud.depth_step_m;
  const double independent = cloud.points / cloud.correlated_px;
  const double noise_m = independent > 1 ? cloud.height_m / std::sqrt(independent) : cloud.height_m;
  return std::hypot(bias_m, noise_m) * area_m2;
}

}  // namespace

UncertaintyBudget VolumeBudget(const BudgetInputs& in) {
  UncertaintyBudget budget;
  budget.matching_m3 = CloudDeviation_m3(in.surface, in.area_m2);
  budget.reference_m3 =
      in.empty_bin ? CloudDeviation_m3(*in.empty_bin, in.area_m2) : kUnseenFloor * in.camera_height_m * in.area_m2;
  budget.calibration_m3 = in.calibration_m3;
  budget.pose_m3 = in.pose_m3;
  budget.completion_m3 = in.completion_deviation_m ? *in.completion_deviation_m * in.interpolated_m2
                                                   : kUnknownCompletion * std::abs(in.interpolated_m3);
  budget.relief_m3 = in.relief_deviation_m * in.relief_m2;
  if (in.shots_deviation_m3) budget.repeat_m3 = *in.shots_deviation_m3 / std::sqrt(static_cast<double>(in.shots));
  return budget;
}

}  // namespace granary
