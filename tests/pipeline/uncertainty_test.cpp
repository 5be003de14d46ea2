// The budget's terms, each against its own small sum.
#include "pipeline/uncertainty.h"

#include <cmath>

#include <gtest/gtest.h>

namespace granary {
namespace {

BudgetInputs SmallBin() {
  BudgetInputs in;
  in.area_m2 = 0.18;
  in.interpolated_m2 = 0.01;
  in.interpolated_m3 = 0.001;
  in.surface = {.height_m = 1e-4, .points = 400'000, .correlated_px = 100, .depth_step_m = 0.006};
  in.empty_bin = CloudNoise{.height_m = 1e-4, .points = 300'000, .correlated_px = 100, .depth_step_m = 0.007};
  in.camera_height_m = 1.1;
  in.completion_deviation_m = 2e-4;
  in.relief_m2 = 0.17;
  in.relief_deviation_m = 1e-4;
  return in;
}

TEST(UncertaintyBudget, TermsAddInQuadrature) {
  const UncertaintyBudget budget{3, 4, 12, 84, 3612, 0, 0};  // 3² + 4² = 5², 5² + 12² = 13², …
  EXPECT_DOUBLE_EQ(budget.Combined_m3(), 3613);
  EXPECT_DOUBLE_EQ(budget.Expanded_m3(), 2 * 3613);
}

TEST(VolumeBudget, NoiseOfSinglePointsAveragesAwayButTheBiasStays) {
  BudgetInputs in = SmallBin();
  const double before = VolumeBudget(in).matching_m3;
  in.surface.points *= 1e6;
  const double bias_only = VolumeBudget(in).matching_m3;
  EXPECT_LT(bias_only, before);
  in.surface.points *= 1e6;
  EXPECT_NEAR(VolumeBudget(in).matching_m3, bias_only, 1e-6 * bias_only);
  EXPECT_GT(bias_only, 0);
}

TEST(VolumeBudget, PointsThatShareTheirNoiseAreFewer) {
  BudgetInputs in = SmallBin();
  in.surface.height_m = 1e-2;  // noise outweighs the bias
  const double before = VolumeBudget(in).matching_m3;
  in.surface.correlated_px *= 4;
  EXPECT_NEAR(VolumeBudget(in).matching_m3, 2 * before, 0.01 * before);
}

TEST(VolumeBudget, AFloorNeverSeenCostsMore) {
  BudgetInputs in = SmallBin();
  const double seen = VolumeBudget(in).reference_m3;
  in.empty_bin.reset();
  EXPECT_GT(VolumeBudget(in).reference_m3, 10 * seen);
}

TEST(VolumeBudget, CompletionCountsTheAreaThatWasMadeUp) {
  EXPECT_DOUBLE_EQ(VolumeBudget(SmallBin()).completion_m3, 2e-4 * 0.01);
}

TEST(VolumeBudget, CompletionOfUnknownErrorIsAShareOfItsVolume) {
  BudgetInputs in = SmallBin();
  in.completion_deviation_m.reset();
  in.interpolated_m3 = -0.001;  // below the floor, by noise
  EXPECT_DOUBLE_EQ(VolumeBudget(in).completion_m3, 0.03 * 0.001);
}

TEST(VolumeBudget, ReliefCountsTheAreaCoveredByGrain) {
  EXPECT_DOUBLE_EQ(VolumeBudget(SmallBin()).relief_m3, 1e-4 * 0.17);
}

TEST(VolumeBudget, RepeatedShotsAverageTheirScatter) {
  BudgetInputs in = SmallBin();
  EXPECT_EQ(VolumeBudget(in).repeat_m3, 0);
  in.shots_deviation_m3 = 6e-6;
  in.shots = 9;
  EXPECT_DOUBLE_EQ(VolumeBudget(in).repeat_m3, 2e-6);
}

}  // namespace
}  // namespace granary
