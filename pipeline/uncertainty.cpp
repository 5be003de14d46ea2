#include "pipeline/uncertainty.h"

#include <cmath>

namespace granary {

namespace {

constexpr double kDisparityBias_px = 0.01;  // worst of level planes, tests/pipeline/stereo/match_test.cpp
constexpr double kScale = 5e-4;             // a good chessboard calibration: 0.05 % of focal length and baseline
constexpr double kCompletion = 0.03;        // share of the interpolated volume
constexpr double kRelief_m = 5e-4;          // wheat: half the span between kernels' envelope and a sheet over them
constexpr double kPose = 1e-3;              // height error of an unseen floor, share of the camera's height

}  // namespace

UncertaintyBudget VolumeUncertainty(const UncertaintyInputs& in) {
  UncertaintyBudget budget;
  budget.matching_m3 = kDisparityBias_px * in.surface_step_m * in.grain_floor_m2;
  budget.reference_m3 =
      (in.floor_measured ? kDisparityBias_px * in.floor_step_m : (kPose + kScale) * in.camera_height_m) *
      in.grain_floor_m2;
  budget.calibration_m3 = kScale * in.volume_m3;
  budget.completion_m3 = kCompletion * std::abs(in.interpolated_m3);
  budget.relief_m3 = kRelief_m * in.grain_floor_m2;
  return budget;
}

}  // namespace granary
