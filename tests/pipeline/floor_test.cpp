// Local planes, and the floor made from them.
#include "pipeline/floor.h"

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "pipeline/local_planes.h"

namespace granary {
namespace {

std::vector<Eigen::Vector3d> Plane(double a, double b, double c) {
  std::vector<Eigen::Vector3d> points;
  for (double y = 0.1; y < 0.3; y += 0.004) {
    for (double x = 0.1; x < 0.4; x += 0.004) points.emplace_back(x, y, a + b * x + c * y);
  }
  return points;
}

TEST(LocalPlanes, AreExactOnAPlane) {
  const LocalPlanes planes(Plane(0.1, 0.2, -0.3), 0.01);
  for (const auto& place : {Eigen::Vector2d(0.2, 0.2), Eigen::Vector2d(0.111, 0.287), Eigen::Vector2d(0.39, 0.105)}) {
    // the ridge on the slopes, 1e-6 of them
    EXPECT_NEAR(*planes.HeightAt(place, 1), 0.1 + 0.2 * place.x() - 0.3 * place.y(), 1e-7);
  }
}

TEST(LocalPlanes, ContinueAPlaneBeyondTheSamples) {
  const LocalPlanes planes(Plane(0.1, 0.2, -0.3), 0.01);
  for (const auto& place : {Eigen::Vector2d(0.05, 0.2), Eigen::Vector2d(0.2, 0.35), Eigen::Vector2d(0.45, 0.05)}) {
    // the ridge on the slopes, 1e-6 of them, over a few cells
    EXPECT_NEAR(*planes.HeightAt(place, 1), 0.1 + 0.2 * place.x() - 0.3 * place.y(), 2e-6);
  }
}

TEST(LocalPlanes, AreNeverSteeperThanTheLimit) {
  const LocalPlanes planes(Plane(0, 3, 0), 0.01);  // samples 3 : 1 steep, up to x = 0.4
  const double rim = 3 * 0.4;
  for (const double beyond : {0.02, 0.05, 0.1, 0.3}) {
    // A height counts from the nearest cell's centre, half a cell inside.
    EXPECT_LE(*planes.HeightAt({0.4 + beyond, 0.2}, 0.5), rim + 0.5 * (beyond + 0.01)) << beyond;
  }
}

TEST(LocalPlanes, FarAwayStayWithinWhatTheSlopeAllows) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 200; ++i) points.emplace_back(0.1 * unit(random), 0.1 * unit(random), 0.2 + 0.05 * unit(random));
  const LocalPlanes planes(points, 0.01);
  const double height = *planes.HeightAt({2, 2}, 0.01);
  EXPECT_GE(height, 0.2 - 0.01 * 2.8);
  EXPECT_LE(height, 0.25 + 0.01 * 2.8);
}

TEST(LocalPlanes, OneSampleGivesItsHeightEverywhere) {
  const std::vector<Eigen::Vector3d> one{{0.3, 0.2, 0.123}};
  const LocalPlanes planes(one, 0.01);
  EXPECT_DOUBLE_EQ(*planes.HeightAt({0.3, 0.2}, 1), 0.123);
  EXPECT_NEAR(*planes.HeightAt({5, -3}, 1), 0.123, 1e-9);
}

TEST(LocalPlanes, SamplesOnOneLineLeaveTheSlopeAcrossAtZero) {
  std::vector<Eigen::Vector3d> line;
  for (double x = 0; x < 0.2; x += 0.004) line.emplace_back(x, 0.1, 0.1 + 0.5 * x);
  const LocalPlanes planes(line, 0.01);
  EXPECT_NEAR(*planes.HeightAt({0.1, 0.13}, 1), 0.15, 1e-3);  // bound far below a slope of 0.5 across
}

TEST(LocalPlanes, WithoutSamplesThereIsNoHeight) { EXPECT_FALSE(LocalPlanes({}, 0.01).HeightAt({0, 0}, 1)); }

TEST(LocalPlanes, RefuseACellWithoutSize) {
  EXPECT_THROW(LocalPlanes({}, 0), std::invalid_argument);
  EXPECT_THROW(LocalPlanes({}, -1), std::invalid_argument);
}

Bin SmallBin() {
  Bin bin;
  bin.footprint_m = {{0, 0}, {0.52, 0}, {0.52, 0.355}, {0, 0.355}};
  bin.height_m = 0.285;
  return bin;
}
/// Tilted by half a degree, with waves of 2 mm.
double Uneven(double x, double y) { return -0.003 + 0.009 * x + 0.002 * std::sin(2 * 3.14159265 * (x + y) / 0.5); }

std::vector<Eigen::Vector3d> EmptyBin() {
  std::vector<Eigen::Vector3d> points;
  for (double y = -0.05; y < 0.4; y += 0.003) {
    for (double x = -0.05; x < 0.57; x += 0.003) points.emplace_back(x, y, Uneven(x, y));
  }
  for (double z = 0; z < 0.285; z += 0.003) {  // two walls, as seen: a millimetre inside the footprint
    for (double x = 0; x < 0.52; x += 0.003) points.emplace_back(x, 0.001, z);
    for (double y = 0; y < 0.355; y += 0.003) points.emplace_back(0.519, y, z);
  }
  return points;
}
constexpr double kCell_m = 0.02, kTolerance_m = 0.012, kMargin_m = 0.01;
/// Waves of 0.5 m bend by 0.02 mm within the reach of a local plane; bilinear cells add as much.
constexpr double kSmoothing_m = 1e-4;

void ExpectFloor(const Floor& floor) {
  for (double y = 0.01; y < 0.35; y += 0.017) {
    for (double x = 0.01; x < 0.51; x += 0.017) {
      ASSERT_NEAR(floor.HeightAt({x, y}), Uneven(x, y), 4 * kSmoothing_m) << x << ", " << y;
    }
  }
}

TEST(Floor, FollowsATiltedUnevenFloor) {
  const Floor floor(EmptyBin(), SmallBin(), kCell_m, kTolerance_m, kMargin_m);
  EXPECT_TRUE(floor.Measured());
  EXPECT_GT(floor.SeenShare(), 0.99);
  ExpectFloor(floor);
}

TEST(Floor, IgnoresCablesAndBeams) {
  auto points = EmptyBin();
  for (double x = 0.05; x < 0.5; x += 0.001) {
    for (double y = 0.15; y < 0.17; y += 0.003) points.emplace_back(x, y, 0.03);  // a cable 3 cm up
    points.emplace_back(x, 0.25, 0.12);
  }
  ExpectFloor(Floor(points, SmallBin(), kCell_m, kTolerance_m, kMargin_m));
}

TEST(Floor, IgnoresPointsThatAreNoNumbers) {
  auto points = EmptyBin();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 1000; ++i) points.emplace_back(0.2, 0.2, nan);
  ExpectFloor(Floor(points, SmallBin(), kCell_m, kTolerance_m, kMargin_m));
}

TEST(Floor, BridgesAPartThatWasNotSeenAndSaysSo) {
  auto points = EmptyBin();
  std::erase_if(points, [](const Eigen::Vector3d& p) { return p.x() > 0.2 && p.x() < 0.3; });
  const Floor floor(points, SmallBin(), kCell_m, kTolerance_m, kMargin_m);
  EXPECT_NEAR(floor.SeenShare(), 1 - 0.1 / 0.5, 0.05);                   // a cell at either side
  EXPECT_NEAR(floor.HeightAt({0.25, 0.17}), Uneven(0.25, 0.17), 0.003);  // the waves it cannot know
}

TEST(Floor, WithoutLevelPointsThereIsNone) {
  std::vector<Eigen::Vector3d> wall;
  for (double z = 0; z < 0.14; z += 0.002) {
    for (double x = 0.05; x < 0.47; x += 0.002) wall.emplace_back(x, 0.2 + 0.3 * z, z);
  }
  EXPECT_THROW(Floor(wall, SmallBin(), kCell_m, 0.002, kMargin_m), std::invalid_argument);
  EXPECT_THROW(Floor({}, SmallBin(), kCell_m, kTolerance_m, kMargin_m), std::invalid_argument);
}

TEST(Floor, IdealFloorIsZeroAndNotMeasured) {
  const Floor floor;
  EXPECT_EQ(floor.HeightAt({0.3, 0.2}), 0);
  EXPECT_FALSE(floor.Measured());
}

TEST(DistanceToEdge_m, CountsFootprintAndPillars) {
  Bin bin = SmallBin();
  bin.exclude_m = {{{0.2, 0.1}, {0.3, 0.1}, {0.3, 0.2}, {0.2, 0.2}}};
  EXPECT_NEAR(DistanceToEdge_m(bin, {0.1, 0.05}), 0.05, 1e-15);
  EXPECT_NEAR(DistanceToEdge_m(bin, {0.18, 0.15}), 0.02, 1e-15);
  EXPECT_NEAR(DistanceToEdge_m(bin, {0.25, 0.18}), 0.02, 1e-15);  // inside the pillar
}

TEST(IsGrainFloor, LeavesOutPillarsAndTheOutside) {
  Bin bin = SmallBin();
  bin.exclude_m = {{{0.2, 0.1}, {0.3, 0.1}, {0.3, 0.2}, {0.2, 0.2}}};
  EXPECT_TRUE(IsGrainFloor(bin, {0.1, 0.1}));
  EXPECT_FALSE(IsGrainFloor(bin, {0.25, 0.15}));
  EXPECT_FALSE(IsGrainFloor(bin, {0.53, 0.1}));
}

}  // namespace
}  // namespace granary
