#include "pipeline/segment.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <random>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

namespace granary {
namespace {

using Cloud = std::vector<Eigen::Vector3f>;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

std::vector<std::uint8_t> BruteForce(const Cloud& points, const Cloud& empty_bin, double distance_m) {
  std::vector<std::uint8_t> scene(points.size(), 0);
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (const auto& q : empty_bin) {
      const Eigen::Vector3d gap = points[i].cast<double>() - q.cast<double>();
      if (gap.x() * gap.x() + gap.y() * gap.y() + gap.z() * gap.z() <= distance_m * distance_m) scene[i] = 1;
    }
  }
  return scene;
}

Cloud RandomCloud(std::size_t count, unsigned seed, float width, float height) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> unit(0, 1);
  Cloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    const float x = unit(random), y = unit(random);
    cloud.emplace_back(width * x - width / 2, width * y, height * unit(random));
  }
  return cloud;
}

/// A wavy, tilted sheet in picture order.
Cloud Sheet(int columns, int rows, float step, float lift, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> noise(0, 0.1F * step);
  Cloud cloud;
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      const float wave = 3 * step * std::sin(0.2F * static_cast<float>(x)) + 0.7F * step * static_cast<float>(y);
      cloud.emplace_back(step * static_cast<float>(x) + noise(random), step * static_cast<float>(y) + noise(random),
                         wave + lift + noise(random));
    }
  }
  return cloud;
}

std::size_t CountSet(const std::vector<std::uint8_t>& flags) {
  return static_cast<std::size_t>(std::count(flags.begin(), flags.end(), 1));
}

TEST(FindScenePoints, EqualsBruteForceOnRandomClouds) {
  const Cloud points = RandomCloud(2000, 1, 1, 1), empty_bin = RandomCloud(1500, 2, 1, 1);
  for (const double distance : {0.0, 0.001, 0.03, 0.1, 0.3, 5.0}) {
    const auto scene = FindScenePoints(points, empty_bin, distance);
    ASSERT_EQ(scene, BruteForce(points, empty_bin, distance)) << distance;
  }
}

TEST(FindScenePoints, EqualsBruteForceOnSheetsForDistancesBelowAndFarAboveTheSpacing) {
  const Cloud empty_bin = Sheet(60, 50, 0.012F, 0, 3);
  for (const float lift : {0.0F, 0.02F, 0.068F, 0.1F}) {
    const Cloud points = Sheet(60, 50, 0.012F, lift, 4);
    for (const double distance : {0.004, 0.012, 0.068, 0.2}) {
      const auto scene = FindScenePoints(points, empty_bin, distance);
      ASSERT_EQ(scene, BruteForce(points, empty_bin, distance)) << lift << " " << distance;
    }
  }
}

TEST(FindScenePoints, EqualsBruteForceWhateverTheOrderOfThePoints) {
  Cloud points = Sheet(60, 50, 0.012F, 0.03F, 5), empty_bin = Sheet(60, 50, 0.012F, 0, 6);
  std::shuffle(points.begin(), points.end(), std::mt19937(7));
  std::shuffle(empty_bin.begin(), empty_bin.end(), std::mt19937(8));
  for (const double distance : {0.004, 0.03, 0.068}) {
    ASSERT_EQ(FindScenePoints(points, empty_bin, distance), BruteForce(points, empty_bin, distance));
  }
}

TEST(FindScenePoints, EqualsBruteForceOnALatticeWhereDistancesTie) {
  // Spacing 1/64 is exact in binary: many pairs are exactly at the distance, and on the borders of cells.
  Cloud points, empty_bin;
  for (int i = 0; i < 12 * 12 * 12; ++i) {
    const Eigen::Vector3f place(static_cast<float>(i % 12) - 6, static_cast<float>(i / 12 % 12) - 6,
                                static_cast<float>(i / 144) - 6);
    (i % 7 == 0 ? empty_bin : points).push_back(place / 64);
  }
  for (const double steps : {1.0, std::sqrt(2.0), 2.0, 3.0}) {
    ASSERT_EQ(FindScenePoints(points, empty_bin, steps / 64), BruteForce(points, empty_bin, steps / 64)) << steps;
  }
}

TEST(FindScenePoints, CountsAPointAtExactlyTheDistanceAsScene) {
  const Cloud empty_bin = {{0, 0, 0}};
  const Cloud points = {{0.25F, 0, 0}, {std::nextafter(0.25F, 1.0F), 0, 0}};
  EXPECT_EQ(FindScenePoints(points, empty_bin, 0.25), (std::vector<std::uint8_t>{1, 0}));
}

TEST(FindScenePoints, FindsOnlyEqualPointsAtDistanceZero) {
  const Cloud empty_bin = {{1, 2, 3}, {4, 5, 6}};
  const Cloud points = {{4, 5, 6}, {4, 5, std::nextafter(6.0F, 7.0F)}, {1, 2, 3}};
  EXPECT_EQ(FindScenePoints(points, empty_bin, 0), (std::vector<std::uint8_t>{1, 0, 1}));
}

TEST(FindScenePoints, LeavesPointsThatAreNotFiniteOut) {
  const Cloud empty_bin = {{kNan, 0, 0}, {0, 0, 0}, {kInfinity, 0, 0}};
  const Cloud points = {{0, 0, kNan}, {0, 0, 0}, {kInfinity, 0, 0}, {kNan, kNan, kNan}};
  EXPECT_EQ(FindScenePoints(points, empty_bin, 0.1), (std::vector<std::uint8_t>{0, 1, 0, 0}));
}

TEST(FindScenePoints, StandsPointsFarBeyondTheGrid) {
  Cloud empty_bin = RandomCloud(500, 9, 1, 1), points = RandomCloud(500, 10, 1, 1);
  for (const float far : {1e8F, -1e8F, 1e30F}) {
    empty_bin.emplace_back(far, far, far);
    points.emplace_back(far, far, far);
    points.emplace_back(far, far, 0);
  }
  for (const double distance : {1e-6, 0.05}) {
    ASSERT_EQ(FindScenePoints(points, empty_bin, distance), BruteForce(points, empty_bin, distance));
  }
}

TEST(FindScenePoints, FindsNothingInAnEmptyBinOfNoPoints) {
  const Cloud points = RandomCloud(100, 11, 1, 1);
  EXPECT_EQ(CountSet(FindScenePoints(points, {}, 0.1)), 0U);
  EXPECT_TRUE(FindScenePoints({}, points, 0.1).empty());
}

TEST(FindScenePoints, RefusesADistanceThatIsNone) {
  const Cloud points = {{0, 0, 0}};
  for (const double bad : {-0.001, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    EXPECT_THROW((void)FindScenePoints(points, points, bad), std::invalid_argument);
  }
}

TEST(PassThroughZ, KeepsBothLimitsAndDropsWhatIsNotFinite) {
  const Cloud points = {{0, 0, 0.1F}, {0, 0, 0.3F},    {0, 0, 0.09F}, {0, 0, 0.31F},
                        {0, 0, kNan}, {kNan, 0, 0.2F}, {0, 0, 0.2F}};
  EXPECT_EQ(PassThroughZ(points, 0.1F, 0.3F), (std::vector<std::uint8_t>{1, 1, 0, 0, 0, 0, 1}));
}

TEST(PassThroughX, FiltersItsOwnAxis) {
  EXPECT_EQ(PassThroughX(Cloud{{1, 5, 9}, {5, 1, 9}}, 0, 2), (std::vector<std::uint8_t>{1, 0}));
}

TEST(PassThroughY, FiltersItsOwnAxis) {
  EXPECT_EQ(PassThroughY(Cloud{{1, 5, 9}, {5, 1, 9}}, 0, 2), (std::vector<std::uint8_t>{0, 1}));
}

TEST(PassThroughZ, DecidesEveryPointOfSeveralChunks) {
  const Cloud points = RandomCloud(100'000, 12, 1, 1);
  const auto inside = PassThroughZ(points, 0.25F, 0.5F);
  for (std::size_t i = 0; i < points.size(); ++i) {
    ASSERT_EQ(inside[i], points[i].z() >= 0.25F && points[i].z() <= 0.5F ? 1 : 0);
  }
}

TEST(PassThroughZ, RefusesLimitsThatEncloseNothing) {
  EXPECT_THROW((void)PassThroughZ({}, 1, 0), std::invalid_argument);
  EXPECT_THROW((void)PassThroughZ({}, kNan, 0), std::invalid_argument);
}

TEST(PassThroughZ, AcceptsACloudWithoutPoints) { EXPECT_TRUE(PassThroughZ({}, 0, 1).empty()); }

TEST(FindOutliers, MarksLonelyPointsAndThoseThatAreNotFinite) {
  Cloud points = Sheet(30, 30, 0.01F, 0, 13);
  points.emplace_back(0.1F, 0.1F, 2);
  points.emplace_back(kNan, 0, 0);
  const auto outlier = FindOutliers(points, 0.05, 4);
  EXPECT_EQ(CountSet(outlier), 2U);
  EXPECT_EQ(outlier[900], 1);
  EXPECT_EQ(outlier[901], 1);
}

TEST(FindOutliers, RefusesARadiusOrACountThatIsNone) {
  EXPECT_THROW((void)FindOutliers({}, 0, 1), std::invalid_argument);
  EXPECT_THROW((void)FindOutliers({}, kNan, 1), std::invalid_argument);
  EXPECT_THROW((void)FindOutliers({}, 0.1, 0), std::invalid_argument);
}

TEST(FindOutliers, MarksEverythingInACloudWithoutFinitePoints) {
  EXPECT_EQ(FindOutliers(Cloud{{kNan, 0, 0}}, 0.1, 1), (std::vector<std::uint8_t>{1}));
}

/// A floor tilted by `slope` with 1 mm of noise, and as much clutter above it.
Cloud FloorAndClutter(float slope, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> noise(0, 0.001F);
  Cloud cloud = RandomCloud(5000, seed + 1, 2, 1);
  for (auto& point : cloud) point.z() += 0.05F;
  for (auto p : RandomCloud(6000, seed + 2, 2, 1)) {
    p.z() = 0.02F + slope * p.x() + noise(random);
    cloud.push_back(p);
  }
  return cloud;
}

TEST(FitFloorPlane, FindsATiltedFloorUnderClutter) {
  const Cloud cloud = FloorAndClutter(0.05F, 14);
  const auto plane = FitFloorPlane(cloud, 0.004);
  ASSERT_TRUE(plane);
  const Eigen::Vector4d& c = plane->coefficients;
  EXPECT_NEAR(c.head<3>().norm(), 1, 1e-12);
  // 1 mm over 6000 points is 0.013 mm; clutter within the tolerance may pull by a little more.
  EXPECT_NEAR(-c(0) / c(2), 0.05, 2e-4);
  EXPECT_NEAR(-c(3) / c(2), 0.02, 1e-4);
  EXPECT_NEAR(plane->inlier_share, 6000.0 / 11000, 0.01);
}

TEST(FitFloorPlane, GivesTheSamePlaneEveryTime) {
  const Cloud cloud = FloorAndClutter(0.02F, 15);
  EXPECT_EQ(FitFloorPlane(cloud, 0.004)->coefficients, FitFloorPlane(cloud, 0.004)->coefficients);
}

TEST(FitFloorPlane, FindsNoneInAWall) {
  Cloud wall = RandomCloud(2000, 16, 1, 1);
  for (auto& point : wall) point.x() = 0;
  EXPECT_FALSE(FitFloorPlane(wall, 0.004));
}

TEST(FitFloorPlane, FindsNoneInTooFewPoints) {
  EXPECT_FALSE(FitFloorPlane({}, 0.004));
  EXPECT_FALSE(FitFloorPlane(Cloud{{0, 0, 0}, {1, 0, 0}}, 0.004));
  EXPECT_FALSE(FitFloorPlane(Cloud{{0, 0, 0}, {1, 0, 0}, {0, 1, kNan}}, 0.004));
}

TEST(FitFloorPlane, FindsNoneInPointsOnALine) {
  Cloud line;
  for (int i = 0; i < 100; ++i) line.emplace_back(static_cast<float>(i), 0.0F, 0.0F);
  EXPECT_FALSE(FitFloorPlane(line, 0.004));
}

TEST(FitFloorPlane, RefusesAToleranceThatIsNone) {
  EXPECT_THROW((void)FitFloorPlane({}, 0), std::invalid_argument);
  EXPECT_THROW((void)FitFloorPlane({}, kNan), std::invalid_argument);
}

}  // namespace
}  // namespace granary
