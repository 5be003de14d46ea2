#include "pipeline/volume.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "pipeline/delaunay.h"


namespace granary {
namespace {

/// The unit square in two triangles, one of them completed; heights equal z.
Surface Square(double z) {
  Surface surface;
  surface.vertices_in_world = {{0, 0, z}, {1, 0, z}, {1, 1, z}, {0, 1, z}};
  surface.height_m = {z, z, z, z};
  surface.interpolated = {0, 0, 0, 1};
  surface.triangles = {{0, 1, 2}, {0, 2, 3}};
  surface.triangle_interpolated = {0, 1};
  return surface;
}

TEST(PrismVolume_m3, IsAreaTimesMeanHeight) { EXPECT_DOUBLE_EQ(PrismVolume_m3(0.5, 1, 2, 6), 1.5); }

TEST(CutAndComplementVolume_m3, EqualsTheClosedFormForRandomTriangles) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0, 1);
  const auto corner = [&] {
    const double x = unit(random), y = unit(random);
    return Eigen::Vector3d(x, y, unit(random));
  };
  for (int i = 0; i < 10000; ++i) {
    const Eigen::Vector3d a = corner(), b = corner(), c = corner();
    const double area = std::abs((b - a).x() * (c - a).y() - (b - a).y() * (c - a).x()) / 2;
    // volumes below 0.5: a few roundings of 1e-16
    ASSERT_NEAR(CutAndComplementVolume_m3(a, b, c), PrismVolume_m3(area, a.z(), b.z(), c.z()), 1e-12);
  }
}

TEST(CutAndComplementVolume_m3, HandlesEqualHeightsAndFlatTriangles) {
  EXPECT_DOUBLE_EQ(CutAndComplementVolume_m3({0, 0, 2}, {1, 0, 2}, {0, 1, 2}), 1.0);
  EXPECT_DOUBLE_EQ(CutAndComplementVolume_m3({0, 0, 1}, {1, 1, 2}, {1, 1, 3}), 0.0);  // a side of no length
}

TEST(IntegrateVolume, SplitsMeasuredAndInterpolated) {
  const VolumeResult result = IntegrateVolume(Square(0.5));
  EXPECT_DOUBLE_EQ(result.total_m3, 0.5);
  EXPECT_DOUBLE_EQ(result.measured_m3, 0.25);
  EXPECT_DOUBLE_EQ(result.interpolated_m3, 0.25);
  EXPECT_DOUBLE_EQ(result.area_m2, 1);
  EXPECT_DOUBLE_EQ(result.measured_area_m2, 0.5);
}

TEST(IntegrateVolume, TakesVolumesFromHeightsAndLevelsFromTheWorld) {
  Surface surface = Square(0.5);
  surface.height_m = {0.4, 0.4, 0.4, 0.4};  // the floor lies at z = 0.1
  surface.vertices_in_world[0].z() = 0.2;
  const VolumeResult result = IntegrateVolume(surface);
  EXPECT_DOUBLE_EQ(result.total_m3, 0.4);
  EXPECT_DOUBLE_EQ(*result.height_mean_m, 0.4);
  EXPECT_DOUBLE_EQ(*result.level_min_m, 0.2);
  EXPECT_DOUBLE_EQ(*result.level_max_m, 0.5);
  EXPECT_DOUBLE_EQ(*result.level_mean_m, 0.4);  // (0.2 + 0.5 + 0.5) / 3 over both triangles
}

TEST(IntegrateVolume, LeavesLevelsEmptyWithoutTriangles) {
  const VolumeResult result = IntegrateVolume({});
  EXPECT_EQ(result.total_m3, 0);
  EXPECT_FALSE(result.level_mean_m || result.level_min_m || result.level_max_m || result.height_mean_m);
}

TEST(IntegrateVolume, LosesNoDigitsOverAMillionPrisms) {
  Surface surface;
  const int side = 708;  // about a million triangles
  std::vector<Eigen::Vector2d> plan;
  for (int y = 0; y <= side; ++y) {
    for (int x = 0; x <= side; ++x) {
      plan.emplace_back(x * 0.001, y * 0.001);
      surface.vertices_in_world.emplace_back(x * 0.001, y * 0.001, 0.1 + 0.3 * x * 0.001);
      surface.height_m.push_back(surface.vertices_in_world.back().z());
      surface.interpolated.push_back(0);
    }
  }
  surface.triangles = TriangulateDelaunay(plan);
  surface.triangle_interpolated.assign(surface.triangles.size(), 0);
  const double width = side * 0.001;
  // the terms themselves are rounded to 1e-13 of their size (differences of coordinates 1000 times the edge)
  EXPECT_NEAR(IntegrateVolume(surface).total_m3, width * width * (0.1 + 0.3 * width / 2), 1e-14);
}

TEST(IntegrateVolume, CountsGrainBelowTheFloorNegative) {
  EXPECT_DOUBLE_EQ(IntegrateVolume(Square(-0.1)).total_m3, -0.1);
}

TEST(IntegrateVolume, RefusesArraysThatDoNotFit) {
  Surface heights = Square(1), flags = Square(1);
  heights.height_m.pop_back();
  flags.triangle_interpolated.pop_back();
  EXPECT_THROW((void)IntegrateVolume(heights), std::invalid_argument);
  EXPECT_THROW((void)IntegrateVolume(flags), std::invalid_argument);
}

TEST(IntegrateVolume, RefusesMissingVerticesClockwiseTrianglesAndNan) {
  Surface missing = Square(1), clockwise = Square(1), nan = Square(1);
  missing.triangles[1][2] = 4;
  std::swap(clockwise.triangles[1][0], clockwise.triangles[1][1]);
  nan.height_m[3] = std::numeric_limits<double>::quiet_NaN();
  for (const Surface& surface : {missing, clockwise, nan}) {
    try {
      (void)IntegrateVolume(surface);
      FAIL();
    } catch (const std::invalid_argument& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("triangle 1"));
    }
  }
}

}  // namespace
}  // namespace granary
