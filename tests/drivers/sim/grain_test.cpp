#include "drivers/sim/grain.h"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/sim/motion.h"
#include "tests/drivers/sim_worlds.h"

namespace granary {
namespace {

class GrainOfShape : public testing::TestWithParam<SimShape> {
 protected:
  Grain grain_{SmallLabWorld().bin, GetParam(), 7};
};

INSTANTIATE_TEST_SUITE_P(Shapes, GrainOfShape,
                         testing::Values(SimShape::kFlat, SimShape::kTiltedLeft, SimShape::kTiltedRight,
                                         SimShape::kConvex, SimShape::kConcave, SimShape::kPartial));

TEST_P(GrainOfShape, HoldsExactlyTheVolumeAskedFor) {
  for (const double volume_m3 : {1e-5, 0.0026, 0.019, 0.0447, 0.0525}) {
    EXPECT_NEAR(grain_.Volume_m3(grain_.SurfaceOf(volume_m3)), volume_m3, 1e-9 * volume_m3);
  }
}

TEST_P(GrainOfShape, StaysBetweenFloorAndRim) {
  for (const double volume_m3 : {0.0005, 0.019, 0.05}) {
    const HeightField surface = grain_.SurfaceOf(volume_m3);
    const auto [low, high] = std::minmax_element(surface.z_m.begin(), surface.z_m.end());
    EXPECT_GE(*low, 0.0);
    EXPECT_LE(*high, 0.285);
  }
}

TEST_P(GrainOfShape, IsNoSteeperThanGrainRests) {
  const HeightField surface = grain_.SurfaceOf(0.019);
  constexpr double kStep_m = 0.05,
                   kBumps_m = 2 * 0.0012 * 0.43;  // bumps ride on top: up on one side, down on the other
  for (double y = 0.02; y < 0.33; y += 0.02) {
    for (double x = 0.02; x < 0.45; x += 0.02) {
      const double rise = std::abs(HeightAt(surface, {x + kStep_m, y}) - HeightAt(surface, {x, y}));
      ASSERT_LE(rise, std::tan(28.0 * M_PI / 180) * kStep_m + kBumps_m) << "at " << x << ", " << y;
    }
  }
}

TEST(Grain, CoversTheFloorButForThePartialShape) {
  for (const SimShape shape :
       {SimShape::kFlat, SimShape::kTiltedLeft, SimShape::kTiltedRight, SimShape::kConvex, SimShape::kConcave}) {
    const HeightField surface = Grain(SmallLabWorld().bin, shape, 7).SurfaceOf(0.019);
    EXPECT_GT(*std::min_element(surface.z_m.begin(), surface.z_m.end()), 0.0);
  }
}

TEST(Grain, LeavesFloorBareInThePartialShape) {
  const HeightField surface = Grain(SmallLabWorld().bin, SimShape::kPartial, 7).SurfaceOf(0.019);
  const auto bare = std::count(surface.z_m.begin(), surface.z_m.end(), 0.0);
  EXPECT_NEAR(static_cast<double>(bare) / static_cast<double>(surface.z_m.size()), 0.13, 0.05);
}

TEST(Grain, LeansAsItsShapeSays) {
  const Eigen::Vector2d left(0.02, 0.18), middle(0.26, 0.18), right(0.5, 0.18);
  const auto heights = [&](SimShape shape) {
    const HeightField s = Grain(SmallLabWorld().bin, shape, 7).SurfaceOf(0.019);
    return std::array{HeightAt(s, left), HeightAt(s, middle), HeightAt(s, right)};
  };
  const auto tilted_left = heights(SimShape::kTiltedLeft), tilted_right = heights(SimShape::kTiltedRight);
  const auto convex = heights(SimShape::kConvex), concave = heights(SimShape::kConcave);
  EXPECT_GT(tilted_left[0], tilted_left[2] + 0.05);
  EXPECT_GT(tilted_right[2], tilted_right[0] + 0.05);
  EXPECT_GT(convex[1], convex[0] + 0.03);
  EXPECT_LT(concave[1], concave[0] - 0.03);
}

TEST(Grain, HasBumpsOfHalfAMillimetreInTheLab) {
  const HeightField surface = Grain(SmallLabWorld().bin, SimShape::kFlat, 7).SurfaceOf(0.019);
  const auto [low, high] = std::minmax_element(surface.z_m.begin(), surface.z_m.end());
  EXPECT_NEAR(*high - *low, 0.001, 0.0002);
}

TEST(Grain, DiffersBySeedOnlyInItsBumps) {
  const Bin bin = SmallLabWorld().bin;
  const HeightField a = Grain(bin, SimShape::kConvex, 1).SurfaceOf(0.019);
  const HeightField b = Grain(bin, SimShape::kConvex, 2).SurfaceOf(0.019);
  double most = 0;
  for (std::size_t k = 0; k < a.z_m.size(); ++k) most = std::max(most, std::abs(a.z_m[k] - b.z_m[k]));
  EXPECT_GT(most, 0.0002);
  EXPECT_LT(most, 0.002);
}

TEST(Grain, HoldsExactlyTheVolumeBetweenPillarsInAnOddFootprint) {
  Bin bin;
  bin.footprint_m = {{0, 0}, {6, 0.5}, {5.5, 4}, {3, 3}, {1, 5}};
  bin.height_m = 4;
  bin.exclude_m = {{{2, 1}, {2.4, 1}, {2.2, 1.5}}};
  const Grain grain(bin, SimShape::kTiltedRight, 3);
  EXPECT_NEAR(grain.Volume_m3(grain.SurfaceOf(20)), 20, 20e-9);
  EXPECT_NEAR(grain.Capacity_m3(), Capacity_m3(bin), 1e-9 * Capacity_m3(bin));
}

TEST(Grain, RefusesMoreThanFitsAndNamesTheLimit) {
  const Grain grain(SmallLabWorld().bin, SimShape::kFlat, 1);
  try {
    (void)grain.SurfaceOf(0.06);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(),
                testing::AllOf(testing::HasSubstr("sim.volume_m3: 0.06"), testing::HasSubstr("0.052611")));
  }
}

TEST(Grain, RefusesAVolumeThatIsNoNumber) {
  const Grain grain(SmallLabWorld().bin, SimShape::kFlat, 1);
  EXPECT_THROW((void)grain.SurfaceOf(std::nan("")), std::invalid_argument);
  EXPECT_THROW((void)grain.SurfaceOf(-0.001), std::invalid_argument);
}

TEST(Grain, RefusesABinWithoutHeight) {
  Bin bin = SmallLabWorld().bin;
  bin.height_m = 0;
  EXPECT_THROW(Grain(bin, SimShape::kFlat, 1), std::invalid_argument);
}

SimOptions Moving(SimMotion motion) {
  SimOptions options;
  options.motion = motion;
  options.volume_m3 = 10;
  options.volume_step_m3 = 3;
  return options;
}

TEST(VolumeAt, StandsStill) { EXPECT_EQ(VolumeAt_m3(Moving(SimMotion::kStill), 5, 1, 20), 10); }

TEST(VolumeAt, FillsToTheMark) {
  EXPECT_EQ(VolumeAt_m3(Moving(SimMotion::kFilling), 2, 1, 20), 16);
  EXPECT_EQ(VolumeAt_m3(Moving(SimMotion::kFilling), 9, 1, 20), 20);
}

TEST(VolumeAt, DrainsToTheMark) {
  EXPECT_EQ(VolumeAt_m3(Moving(SimMotion::kDraining), 2, 1, 20), 4);
  EXPECT_EQ(VolumeAt_m3(Moving(SimMotion::kDraining), 9, 1, 20), 1);
}

TEST(VolumeAt, NeverDrainsWhenToldToFill) { EXPECT_EQ(VolumeAt_m3(Moving(SimMotion::kFilling), 3, 1, 8), 10); }

TEST(VolumeAt, CyclesBetweenTheMarks) {
  const SimOptions options = Moving(SimMotion::kCycle);
  std::vector<double> volumes;
  for (int step = 0; step < 14; ++step) volumes.push_back(VolumeAt_m3(options, step, 1, 20));
  EXPECT_THAT(volumes, testing::ElementsAre(10, 13, 16, 19, 18, 15, 12, 9, 6, 3, 2, 5, 8, 11));
}

}  // namespace
}  // namespace granary
