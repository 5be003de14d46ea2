// One pass over the triangles against a surface built anew for each limit, and what counts as a plateau.
#include "pipeline/edge_sweep.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "pipeline/volume.h"

namespace granary {
namespace {

constexpr double kSpacing_m = 0.001;

Bin SmallBin() {
  Bin bin;
  bin.footprint_m = {{0, 0}, {0.1, 0}, {0.1, 0.07}, {0, 0.07}};
  bin.height_m = 0.1;
  return bin;
}

/// Points a spacing apart on an uneven heap, each shaken by a third of it, with holes of several sizes.
std::vector<Eigen::Vector3d> ShakenPoints() {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> shake(-kSpacing_m / 3, kSpacing_m / 3);
  std::vector<Eigen::Vector3d> points;
  for (double y = 0.002; y < 0.068; y += kSpacing_m) {
    for (double x = 0.002; x < 0.098; x += kSpacing_m) {
      const Eigen::Vector2d place(x + shake(random), y + shake(random));
      bool seen = true;
      for (int hole = 1; hole <= 5; ++hole) {
        seen = seen && (place - Eigen::Vector2d(0.017 * hole, 0.035)).norm() > 0.0008 * hole;
      }
      if (seen) points.emplace_back(place.x(), place.y(), 0.03 + 0.02 * std::sin(60 * place.x()) + 0.1 * place.y());
    }
  }
  return points;
}

TEST(SweepEdgeLimits, GivesWhatASurfaceBuiltForEachLimitGives) {
  const Bin bin = SmallBin();
  const auto points = ShakenPoints();
  const Surface automatic = BuildSurface(points, Floor(), bin, kSpacing_m, {});
  const std::vector<double> limits_m{0.0005, 0.0011, 0.0013, 0.0016, 0.002, 0.0025, 0.004, 0.02};
  const auto steps = SweepEdgeLimits(automatic, limits_m);
  ASSERT_EQ(steps.size(), limits_m.size());
  for (std::size_t i = 0; i < limits_m.size(); ++i) {
    const VolumeResult built = IntegrateVolume(BuildSurface(points, Floor(), bin, kSpacing_m, limits_m[i]));
    // Compensated sums in another order differ in the last digits only.
    const double digits = 1e-14 * steps.back().total_m3;
    EXPECT_EQ(steps[i].edge_threshold_m, limits_m[i]);
    EXPECT_NEAR(steps[i].total_m3, built.total_m3, digits) << limits_m[i];
    EXPECT_NEAR(steps[i].measured_m3, built.measured_m3, digits) << limits_m[i];
    EXPECT_NEAR(steps[i].interpolated_m3, built.interpolated_m3, digits) << limits_m[i];
    EXPECT_NEAR(steps[i].area_m2, built.area_m2, 1e-14) << limits_m[i];
    EXPECT_NEAR(steps[i].measured_area_m2, built.measured_area_m2, 1e-14) << limits_m[i];
  }
  // The limits tell something apart only when the volumes differ.
  EXPECT_LT(steps[1].total_m3, 0.9 * steps[4].total_m3);
}

TEST(SweepEdgeLimits, DoesNotDependOnTheLimitTheSurfaceWasBuiltWith) {
  const auto points = ShakenPoints();
  const std::vector<double> limits_m{0.0012, 0.0018, 0.003};
  const auto tight = SweepEdgeLimits(BuildSurface(points, Floor(), SmallBin(), kSpacing_m, 0.001), limits_m);
  const auto wide = SweepEdgeLimits(BuildSurface(points, Floor(), SmallBin(), kSpacing_m, 1.0), limits_m);
  for (std::size_t i = 0; i < limits_m.size(); ++i) {
    EXPECT_NEAR(tight[i].total_m3, wide[i].total_m3, 1e-14 * wide[i].total_m3) << limits_m[i];
  }
}

TEST(SweepEdgeLimits, AnEdgeAsLongAsTheLimitIsKept) {
  Surface surface;
  surface.vertices_in_world = {{0, 0, 1}, {4, 0, 1}, {0, 3, 1}};
  surface.height_m = {1, 1, 1};
  surface.interpolated = {0, 0, 0};
  surface.too_long = {{0, 1, 2}};
  const auto steps = SweepEdgeLimits(surface, std::vector<double>{std::nextafter(5.0, 0.0), 5.0});
  EXPECT_EQ(steps[0].total_m3, 0);
  EXPECT_EQ(steps[1].total_m3, 6);
}

TEST(SweepEdgeLimits, AnEmptySurfaceGivesZeros) {
  const auto steps = SweepEdgeLimits(Surface{}, std::vector<double>{0.001, 0.002});
  ASSERT_EQ(steps.size(), 2U);
  EXPECT_EQ(steps[1].total_m3, 0);
  EXPECT_EQ(steps[1].area_m2, 0);
}

TEST(SweepEdgeLimits, NoLimitsGiveNoSteps) { EXPECT_TRUE(SweepEdgeLimits(Surface{}, std::vector<double>{}).empty()); }

TEST(SweepEdgeLimits, RefusesLimitsThatAreNoLengthsOrDoNotAscend) {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinite = std::numeric_limits<double>::infinity();
  for (const std::vector<double>& limits_m :
       {std::vector<double>{0.0}, {-0.001}, {nan}, {infinite}, {0.001, nan}, {0.002, 0.001}, {0.001, 0.001}}) {
    EXPECT_THROW((void)SweepEdgeLimits(Surface{}, limits_m), std::invalid_argument) << limits_m.back();
  }
}

TEST(SweepEdgeLimits, RefusesArraysThatDoNotFit) {
  const std::vector<double> limits_m{1.0};
  Surface surface;
  surface.vertices_in_world = {{0, 0, 1}, {1, 0, 1}, {0, 1, 1}};
  surface.height_m = {1, 1, 1};
  EXPECT_THROW((void)SweepEdgeLimits(surface, limits_m), std::invalid_argument);  // no flags
  surface.interpolated = {0, 0, 0};
  surface.triangles = {{0, 1, 3}};
  EXPECT_THROW((void)SweepEdgeLimits(surface, limits_m), std::invalid_argument);
  surface.triangles = {{0, 1, 2}};
  surface.height_m[1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW((void)SweepEdgeLimits(surface, limits_m), std::invalid_argument);
}

std::vector<double> Limits(std::size_t count) {
  std::vector<double> limits_m;
  for (std::size_t i = 1; i <= count; ++i) limits_m.push_back(static_cast<double>(i));
  return limits_m;
}

TEST(FindPlateau, IsTheLongestRunWithinTheSpread) {
  const std::vector<double> volumes_m3{1.5, 1.501, 1.502, 1.9, 2.0, 2.001, 2.0005, 2.0, 2.1};
  const auto plateau = FindPlateau(Limits(9), volumes_m3);
  ASSERT_TRUE(plateau);
  EXPECT_EQ(plateau->from_m, 5);
  EXPECT_EQ(plateau->to_m, 8);
  EXPECT_NEAR(plateau->volume_m3, 2.000375, 1e-12);
  EXPECT_NEAR(plateau->spread_percent, 100 * 0.001 / 2.001, 1e-9);
}

TEST(FindPlateau, OfTwoAsLongTheFlatterCounts) {
  const std::vector<double> volumes_m3{1.0, 1.0005, 1.0, 1.5, 2.0, 2.0, 2.0};
  EXPECT_EQ(FindPlateau(Limits(7), volumes_m3)->from_m, 5);
}

TEST(FindPlateau, ASlowDriftIsNone) {
  std::vector<double> volumes_m3;  // 0.06 % a step: two steps are more than 0.1 %
  for (int i = 0; i < 20; ++i) volumes_m3.push_back(1 + 0.0006 * i);
  EXPECT_FALSE(FindPlateau(Limits(20), volumes_m3));
}

TEST(FindPlateau, TwoLimitsAreTooFew) {
  EXPECT_FALSE(FindPlateau(Limits(2), std::vector<double>{1, 1}));
  EXPECT_FALSE(FindPlateau({}, {}));
}

TEST(FindPlateau, NoiseAroundNothingIsNone) {
  EXPECT_FALSE(FindPlateau(Limits(4), std::vector<double>{1e-9, -1e-9, 2e-9, -1e-9}));
}

TEST(FindPlateau, NoTrianglesAtAllAreNoPlateau) {
  EXPECT_FALSE(FindPlateau(Limits(4), std::vector<double>{0, 0, 0, 0}));
  const auto later = FindPlateau(Limits(8), std::vector<double>{0, 0, 0, 0, 0, 3, 3, 3});
  ASSERT_TRUE(later);
  EXPECT_EQ(later->from_m, 6);
}

TEST(FindPlateau, NegativeVolumesHaveOneToo) {
  const auto plateau = FindPlateau(Limits(3), std::vector<double>{-2, -2.001, -2});
  ASSERT_TRUE(plateau);
  EXPECT_NEAR(plateau->spread_percent, 100 * 0.001 / 2.001, 1e-9);
}

TEST(FindPlateau, RefusesWhatDoesNotFit) {
  EXPECT_THROW((void)FindPlateau(Limits(3), std::vector<double>{1, 1}), std::invalid_argument);
  EXPECT_THROW((void)FindPlateau(Limits(3), std::vector<double>{1, NAN, 1}), std::invalid_argument);
}

}  // namespace
}  // namespace granary
