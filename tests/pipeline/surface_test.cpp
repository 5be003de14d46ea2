// Surfaces whose volume is known in closed form: a plane of heights stays one however it is triangulated.
#include "pipeline/surface.h"

#include <cmath>
#include <functional>
#include <optional>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "pipeline/edge_limit.h"
#include "pipeline/volume.h"

namespace granary {
namespace {

constexpr double kSpacing_m = 0.004;

Bin BoxBin() {
  Bin bin;
  bin.footprint_m = {{0, 0}, {0.52, 0}, {0.52, 0.355}, {0, 0.355}};
  bin.height_m = 0.285;
  return bin;
}
Bin LBin() {
  Bin bin = BoxBin();
  bin.footprint_m = {{0, 0}, {0.52, 0}, {0.52, 0.15}, {0.2, 0.15}, {0.2, 0.355}, {0, 0.355}};
  return bin;
}
double Tilted(const Eigen::Vector2d& p) { return 0.05 + 0.2 * p.x() + 0.1 * p.y(); }

/// Points every kSpacing_m on the grain floor, clear of its edges, where `keep` says so.
std::vector<Eigen::Vector3d> Measured(
    const Bin& bin, const std::function<double(const Eigen::Vector2d&)>& height,
    const std::function<bool(const Eigen::Vector2d&)>& keep = [](const Eigen::Vector2d&) { return true; }) {
  std::vector<Eigen::Vector3d> points;
  for (double y = 0.001; y < 0.4; y += kSpacing_m) {
    for (double x = 0.001; x < 0.55; x += kSpacing_m) {
      const Eigen::Vector2d place(x, y);
      if (!IsGrainFloor(bin, place) || DistanceToEdge_m(bin, place) < 5 * kSpacing_m || !keep(place)) continue;
      points.emplace_back(x, y, height(place));
    }
  }
  return points;
}

TEST(BuildSurface, ATiltedPlaneMeasuredInsideFillsTheBinToTheWalls) {
  const Bin bin = BoxBin();
  const VolumeResult volume = IntegrateVolume(BuildSurface(Measured(bin, Tilted), Floor(), bin, kSpacing_m, {}));
  const double truth = 0.52 * 0.355 * Tilted({0.26, 0.1775});
  EXPECT_NEAR(volume.total_m3, truth, 1e-6 * truth);
  EXPECT_NEAR(volume.area_m2, GrainFloor_m2(bin), 1e-9);
}

TEST(BuildSurface, WhatWasMadeUpAlongTheWallsIsFlagged) {
  const Bin bin = BoxBin();
  const auto measured = Measured(bin, Tilted);
  const Surface surface = BuildSurface(measured, Floor(), bin, kSpacing_m, {});
  const VolumeResult volume = IntegrateVolume(surface);
  // Measured area: the rectangle between the outermost points.
  Eigen::Vector2d low = measured[0].head<2>(), high = low;
  for (const auto& p : measured) {
    low = low.cwiseMin(p.head<2>());
    high = high.cwiseMax(p.head<2>());
  }
  EXPECT_NEAR(volume.measured_area_m2, (high - low).prod(), 1e-9);
  for (std::size_t i = 0; i < surface.vertices_in_world.size(); ++i) {
    ASSERT_EQ(surface.interpolated[i] != 0, i >= measured.size());
  }
}

TEST(BuildSurface, AHoleIsCompletedAndFlagged) {
  const Bin bin = BoxBin();
  const auto hole = [](const Eigen::Vector2d& p) { return (p - Eigen::Vector2d(0.25, 0.17)).norm() > 0.05; };
  const VolumeResult whole = IntegrateVolume(BuildSurface(Measured(bin, Tilted), Floor(), bin, kSpacing_m, {}));
  const VolumeResult holed = IntegrateVolume(BuildSurface(Measured(bin, Tilted, hole), Floor(), bin, kSpacing_m, {}));
  EXPECT_NEAR(holed.total_m3, whole.total_m3, 1e-6 * whole.total_m3);
  EXPECT_NEAR(holed.area_m2, GrainFloor_m2(bin), 1e-9);
  // the disc and the triangles at its rim: up to a spacing or two more
  const double missing = whole.measured_area_m2 - holed.measured_area_m2;
  EXPECT_GT(missing, 3.14159 * 0.05 * 0.05);
  EXPECT_LT(missing, 3.14159 * 0.06 * 0.06);
}

TEST(BuildSurface, PillarsAreLeftOutExactly) {
  Bin bin = BoxBin();
  bin.exclude_m = {{{0.2, 0.1}, {0.3, 0.1}, {0.3, 0.2}, {0.2, 0.2}}, {{0.4, 0.25}, {0.45, 0.28}, {0.41, 0.3}}};
  const VolumeResult volume =
      IntegrateVolume(BuildSurface(Measured(bin, [](const auto&) { return 0.1; }), Floor(), bin, kSpacing_m, {}));
  EXPECT_NEAR(volume.area_m2, GrainFloor_m2(bin), 1e-9);
  EXPECT_NEAR(volume.total_m3, 0.1 * GrainFloor_m2(bin), 1e-8);
}

TEST(BuildSurface, AnLShapedFootprintIsFilledExactly) {
  const Bin bin = LBin();
  const VolumeResult volume = IntegrateVolume(BuildSurface(Measured(bin, Tilted), Floor(), bin, kSpacing_m, {}));
  const double truth = 0.52 * 0.15 * Tilted({0.26, 0.075}) + 0.2 * 0.205 * Tilted({0.1, 0.2525});
  EXPECT_NEAR(volume.area_m2, GrainFloor_m2(bin), 1e-9);
  EXPECT_NEAR(volume.total_m3, truth, 1e-6 * truth);
}

TEST(BuildSurface, HeightsCountFromTheMeasuredFloor) {
  const Bin bin = BoxBin();
  std::vector<Eigen::Vector3d> floor_points;
  for (double y = 0; y < 0.36; y += 0.004) {
    for (double x = 0; x < 0.52; x += 0.004) floor_points.emplace_back(x, y, 0.004 + 0.01 * x);
  }
  const Floor floor(floor_points, bin, 0.02, 0.005, 0.01);
  const VolumeResult volume = IntegrateVolume(BuildSurface(Measured(bin, Tilted), floor, bin, kSpacing_m, {}));
  const double truth = 0.52 * 0.355 * (Tilted({0.26, 0.1775}) - 0.004 - 0.01 * 0.26);
  EXPECT_NEAR(volume.total_m3, truth, 1e-5 * truth);  // floor points are floats, slopes have a trace of ridge
}

TEST(BuildSurface, CompletedPointsStayBelowTheTopOfTheBin) {
  const Bin bin = BoxBin();
  const auto steep = [](const Eigen::Vector2d& p) { return 0.05 + 0.45 * p.x(); };  // reaches the top at x = 0.522
  const Surface surface =
      BuildSurface(Measured(bin, steep, [](const auto& p) { return p.x() < 0.4; }), Floor(), bin, kSpacing_m, {});
  for (std::size_t i = 0; i < surface.vertices_in_world.size(); ++i) {
    ASSERT_TRUE(!surface.interpolated[i] || surface.vertices_in_world[i].z() <= bin.height_m);
  }
}

TEST(BuildSurface, TooSmallAnEdgeLimitLeavesHoles) {
  const Bin bin = BoxBin();
  const auto measured = Measured(bin, Tilted);
  const auto volume = [&](std::optional<double> limit_m) {
    return IntegrateVolume(BuildSurface(measured, Floor(), bin, kSpacing_m, limit_m)).total_m3;
  };
  EXPECT_LT(volume(1.5 * kSpacing_m), 0.9 * volume({}));
  EXPECT_EQ(volume(0.5 * kSpacing_m), 0);
}

TEST(BuildSurface, StatesTheLimitItUsed) {
  const Bin bin = BoxBin();
  const auto measured = Measured(bin, Tilted);
  EXPECT_DOUBLE_EQ(BuildSurface(measured, Floor(), bin, kSpacing_m, {}).edge_threshold_m, kEdgeSpacings * kSpacing_m);
  EXPECT_DOUBLE_EQ(BuildSurface(measured, Floor(), bin, kSpacing_m, 0.0042).edge_threshold_m, 0.0042);
}

TEST(BuildSurface, WithoutPointsThereIsNoSurface) {
  EXPECT_TRUE(BuildSurface({}, Floor(), BoxBin(), kSpacing_m, {}).Empty());
}

TEST(BuildSurface, RefusesAMeaninglessSpacing) {
  const auto measured = Measured(BoxBin(), Tilted);
  for (const double spacing : {0.0, -0.004, std::nan("")}) {
    EXPECT_THROW(static_cast<void>(BuildSurface(measured, Floor(), BoxBin(), spacing, {})), std::invalid_argument);
  }
}

}  // namespace
}  // namespace granary
