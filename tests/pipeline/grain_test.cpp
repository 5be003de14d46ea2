// A cloud seen straight from above, one point every 4 mm, put together by hand.
#include "pipeline/grain.h"

#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

namespace granary {
namespace {

constexpr float kPitch_m = 0.004f;
const cv::Size kSize{150, 100};  // 0.6 × 0.4 m, the bin from (0.04, 0.02) on

Bin BoxBin() {
  Bin bin;
  bin.footprint_m = {{0.04, 0.02}, {0.56, 0.02}, {0.56, 0.375}, {0.04, 0.375}};
  bin.height_m = 0.285;
  return bin;
}
float X(int column) { return (static_cast<float>(column) + 0.5f) * kPitch_m; }
float Y(int row) { return (static_cast<float>(row) + 0.5f) * kPitch_m; }

cv::Mat Cloud(const std::function<float(float, float)>& z) {
  cv::Mat points(kSize, CV_32FC3);
  for (int y = 0; y < kSize.height; ++y) {
    for (int x = 0; x < kSize.width; ++x) points.at<cv::Vec3f>(y, x) = {X(x), Y(y), z(X(x), Y(y))};
  }
  return points;
}
cv::Mat Level(float z) {
  return Cloud([z](float, float) { return z; });
}
const cv::Mat kSmooth(kSize, CV_32FC1, cv::Scalar(30));  // a disparity without steps

GrainPoints Find(const cv::Mat& points, const cv::Mat& empty_bin, const GrainOptions& options = {},
                 const cv::Mat& disparity = kSmooth, const Bin& bin = BoxBin()) {
  return FindGrain(points, disparity, empty_bin, Floor(), bin, options);
}
bool Kept(const GrainPoints& grain, float x, float y) {
  return grain.mask.at<std::uint8_t>(static_cast<int>(y / kPitch_m), static_cast<int>(x / kPitch_m)) != 0;
}

TEST(FindGrain, KeepsGrainAndBareFloor) {
  // Half the floor lies bare; the empty bin is the same floor.
  const auto half = [](float x, float) { return x < 0.3f ? 0.0f : 0.1f; };
  const GrainPoints grain = Find(Cloud(half), Level(0));
  EXPECT_TRUE(Kept(grain, 0.1f, 0.2f));
  EXPECT_TRUE(Kept(grain, 0.45f, 0.2f));
  EXPECT_EQ(static_cast<std::size_t>(cv::countNonZero(grain.mask)), grain.points_in_world.size());
}

TEST(FindGrain, DropsAHandfulOfPointsThatStandsAlone) {
  // Nothing was seen around 3 × 3 points in the middle of the grain.
  cv::Mat points = Level(0.1f);
  const int column = static_cast<int>(0.3f / kPitch_m), row = static_cast<int>(0.2f / kPitch_m);
  const cv::Mat alone = points(cv::Rect(column - 1, row - 1, 3, 3)).clone();
  points(cv::Rect(column - 8, row - 8, 17, 17)).setTo(cv::Scalar::all(std::numeric_limits<float>::quiet_NaN()));
  alone.copyTo(points(cv::Rect(column - 1, row - 1, 3, 3)));
  const GrainPoints grain = Find(points, Level(0));
  EXPECT_FALSE(Kept(grain, 0.302f, 0.202f));
  EXPECT_TRUE(Kept(grain, 0.2f, 0.2f));
}

TEST(FindGrain, RemovesWhatStoodInTheEmptyBin) {
  // A beam at 0.15 m that the grain at 0.1 m does not cover.
  const auto beam = [](float x, float) { return x > 0.3f && x < 0.34f; };
  const cv::Mat empty = Cloud([&](float x, float y) { return beam(x, y) ? 0.15f : 0.0f; });
  const cv::Mat full = Cloud([&](float x, float y) { return beam(x, y) ? 0.151f : 0.1f; });
  const GrainPoints grain = Find(full, empty);
  EXPECT_FALSE(Kept(grain, 0.32f, 0.2f));
  EXPECT_TRUE(Kept(grain, 0.2f, 0.2f));
}

TEST(FindGrain, KeepsWhatIsFartherFromTheEmptyBinThanTheDistance) {
  const auto beam = [](float x) { return x > 0.3f && x < 0.34f; };
  const cv::Mat empty = Cloud([&](float x, float) { return beam(x) ? 0.15f : 0.0f; });
  const cv::Mat full = Cloud([&](float x, float) { return beam(x) ? 0.155f : 0.1f; });  // 5 mm of grain on the beam
  EXPECT_TRUE(Kept(Find(full, empty), 0.32f, 0.2f));
}

TEST(FindGrain, WithoutAReferenceNothingIsScene) {
  const GrainPoints grain = Find(Level(0.1f), cv::Mat());
  EXPECT_TRUE(Kept(grain, 0.32f, 0.2f));
}

TEST(FindGrain, LeavesOutTheStripAlongWallsAndPillars) {
  Bin bin = BoxBin();
  bin.exclude_m = {{{0.2, 0.1}, {0.3, 0.1}, {0.3, 0.2}, {0.2, 0.2}}};
  const GrainPoints grain = Find(Level(0.1f), cv::Mat(), {.edge_margin_m = 0.01}, kSmooth, bin);
  for (const auto& p : grain.points_in_world) {
    ASSERT_TRUE(IsGrainFloor(bin, p.head<2>()));
    ASSERT_GT(DistanceToEdge_m(bin, p.head<2>()), 0.01);
  }
  // All others are there: (0.5 × 0.335 − 0.12 × 0.12) m² of points 4 mm apart, give or take a row at each edge.
  const double expected = (0.5 * 0.335 - 0.12 * 0.12) / (kPitch_m * kPitch_m);
  const double row = (2 * (0.5 + 0.335) + 4 * 0.12) / kPitch_m;
  EXPECT_NEAR(static_cast<double>(grain.points_in_world.size()), expected, row);
}

TEST(FindGrain, LeavesOutPointsOutsideTheFootprint) {
  const GrainPoints grain = Find(Level(0.1f), cv::Mat());
  EXPECT_FALSE(Kept(grain, 0.02f, 0.2f));
  EXPECT_FALSE(Kept(grain, 0.3f, 0.39f));
}

TEST(FindGrain, CountsPointsAboveTheBinAndDoesNotKeepThem) {
  const cv::Mat cloud = Cloud([](float x, float) { return x < 0.17f ? 0.4f : 0.1f; });  // a quarter of the bin
  const GrainPoints grain = Find(cloud, cv::Mat());
  EXPECT_NEAR(grain.above_share, 0.25, 0.01);  // a column of points is 0.8 %
  EXPECT_FALSE(Kept(grain, 0.1f, 0.2f));
  EXPECT_TRUE(Kept(grain, 0.3f, 0.2f));
}

TEST(FindGrain, LeavesOutPointsBelowTheFloor) { EXPECT_TRUE(Find(Level(-0.1f), cv::Mat()).points_in_world.empty()); }

TEST(FindGrain, LeavesOutWhereAWindowSeesTwoSurfaces) {
  cv::Mat disparity = kSmooth.clone();
  disparity(cv::Rect(75, 0, 75, kSize.height)).setTo(36);
  const GrainPoints grain = Find(Level(0.1f), cv::Mat(), {.step_margin_px = 5}, disparity);
  for (int x = 70; x <= 79; ++x) EXPECT_EQ(grain.mask.at<std::uint8_t>(50, x), 0) << x;
  EXPECT_EQ(grain.mask.at<std::uint8_t>(50, 66), 255);
  EXPECT_EQ(grain.mask.at<std::uint8_t>(50, 84), 255);
}

TEST(FindGrain, LeavesOutSingleSpikes) {
  cv::Mat disparity = kSmooth.clone();
  disparity.at<float>(50, 75) = 31.2f;  // a step too small to count as one
  const GrainPoints grain = Find(Level(0.1f), cv::Mat(), {}, disparity);
  EXPECT_EQ(grain.mask.at<std::uint8_t>(50, 75), 0);
  EXPECT_EQ(grain.mask.at<std::uint8_t>(50, 76), 255);
}

TEST(FindGrain, InvalidPointsAreNoPoints) {
  cv::Mat cloud = Level(0.1f), disparity = kSmooth.clone();
  const cv::Rect hole(60, 40, 20, 20);
  cloud(hole).setTo(cv::Scalar::all(std::numeric_limits<float>::quiet_NaN()));
  disparity(hole).setTo(std::numeric_limits<float>::infinity());
  const GrainPoints grain = Find(cloud, cv::Mat(), {}, disparity);
  EXPECT_EQ(cv::countNonZero(grain.mask(hole)), 0);
  EXPECT_EQ(grain.mask.at<std::uint8_t>(50, 90), 255);
}

TEST(FindGrain, StatesTheSpacing) { EXPECT_NEAR(Find(Level(0.1f), cv::Mat()).spacing_m, kPitch_m, 1e-6); }

TEST(FindGrain, NoPointsGiveAnEmptyAnswer) {
  const GrainPoints grain = Find(Level(std::numeric_limits<float>::quiet_NaN()), cv::Mat(), {},
                                 cv::Mat(kSize, CV_32FC1, cv::Scalar(std::numeric_limits<float>::infinity())));
  EXPECT_TRUE(grain.points_in_world.empty());
  EXPECT_EQ(grain.spacing_m, 0);
  EXPECT_EQ(grain.above_share, 0);
}

}  // namespace
}  // namespace granary
