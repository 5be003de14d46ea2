#include "pipeline/relief.h"

#include <gtest/gtest.h>

#include "pipeline/volume.h"

namespace granary {
namespace {

/// A square metre of level grain in two triangles, its floor at z = 0.1.
Surface Level(double height_m) {
  Surface surface;
  for (const auto& [x, y] : {std::pair{0.0, 0.0}, {1.0, 0.0}, {1.0, 1.0}, {0.0, 1.0}}) {
    surface.vertices_in_world.emplace_back(x, y, 0.1 + height_m);
    surface.height_m.push_back(height_m);
    surface.interpolated.push_back(0);
  }
  surface.triangles = {{0, 1, 2}, {0, 2, 3}};
  surface.triangle_interpolated = {0, 0};
  return surface;
}

TEST(TakeReliefOff, LowersGrainByTheOffset) {
  Surface surface = Level(0.2);
  TakeReliefOff(0.0006, surface);
  EXPECT_NEAR(IntegrateVolume(surface).total_m3, 0.2 - 0.0006, 1e-12);
  EXPECT_NEAR(surface.vertices_in_world[0].z(), 0.3 - 0.0006, 1e-12);
}

TEST(TakeReliefOff, LeavesTheBareFloorAlone) {
  Surface surface = Level(0);
  TakeReliefOff(0.0006, surface);
  EXPECT_EQ(IntegrateVolume(surface).total_m3, 0);
  surface = Level(-0.0001);  // noise
  TakeReliefOff(0.0006, surface);
  EXPECT_DOUBLE_EQ(IntegrateVolume(surface).total_m3, -0.0001);
}

TEST(ReliefArea_m2, IsWhatAMetreOfOffsetWouldChange) {
  Surface surface = Level(0.2);
  surface.height_m[2] = 0.001;  // a corner in the toe
  const double area_m2 = ReliefArea_m2(surface), before_m3 = IntegrateVolume(surface).total_m3;
  TakeReliefOff(0.0006, surface);
  EXPECT_NEAR(before_m3 - IntegrateVolume(surface).total_m3, 0.0006 * area_m2, 1e-15);
  EXPECT_LT(area_m2, 1);
}

TEST(ReliefDeviation_m, SmoothSimulatedGrainHasNone) {
  EXPECT_EQ(ReliefDeviation_m({}, true), 0);
  EXPECT_GT(ReliefDeviation_m({}, false), 0);
}

TEST(ReliefDeviation_m, IsHalfTheExpandedOneOrAQuarterOfTheOffset) {
  GrainKind grain;
  grain.surface_offset_m = 0.0006;
  EXPECT_DOUBLE_EQ(ReliefDeviation_m(grain, false), 0.00015);
  grain.surface_offset_u95_m = 0.0001;
  EXPECT_DOUBLE_EQ(ReliefDeviation_m(grain, false), 0.00005);
}

}  // namespace
}  // namespace granary
