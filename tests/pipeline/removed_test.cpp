// Which points were removed, and why.
#include <cstdint>
#include <limits>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "pipeline/removed.h"

namespace granary {
namespace {

using testing::ElementsAre;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// 1 m square, 0.5 m high, with a pillar 0.2 m wide in its middle.
Bin BoxWithPillar() {
  Bin bin;
  bin.footprint_m = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  bin.height_m = 0.5;
  bin.exclude_m = {{{0.4, 0.4}, {0.6, 0.4}, {0.6, 0.6}, {0.4, 0.6}}};
  return bin;
}

/// One row of points; the first is kept, 0.05 m from a wall.
RemovedPoints Remove(const std::vector<cv::Vec3f>& others) {
  cv::Mat points(1, static_cast<int>(others.size()) + 1, CV_32FC3);
  points.at<cv::Vec3f>(0, 0) = {0.05F, 0.3F, 0.1F};
  for (std::size_t i = 0; i < others.size(); ++i) points.at<cv::Vec3f>(0, static_cast<int>(i) + 1) = others[i];
  cv::Mat mask = cv::Mat::zeros(points.size(), CV_8UC1);
  mask.at<std::uint8_t>(0, 0) = 255;
  return FindRemoved(points, mask, BoxWithPillar());
}

TEST(FindRemoved, KeptAndInvalidPointsAreNotAmongThem) {
  const RemovedPoints removed = Remove({{kNan, kNan, kNan}, {0.2F, 0.3F, 0.1F}});
  ASSERT_EQ(removed.points_in_world.size(), 1U);
  EXPECT_EQ(removed.points_in_world[0], Eigen::Vector3f(0.2F, 0.3F, 0.1F));
}
TEST(FindRemoved, NearerToAnEdgeThanKeptPointsIsWall) {
  EXPECT_THAT(Remove({{0.01F, 0.5F, 0.1F}, {0.38F, 0.5F, 0.1F}, {-0.02F, 0.5F, 0.4F}}).why,
              ElementsAre(Removal::kWall, Removal::kWall, Removal::kWall));
}
TEST(FindRemoved, OffTheGrainFloorIsOutside) {
  EXPECT_THAT(Remove({{2, 0.5F, 0}, {0.5F, 0.5F, 0.1F}}).why, ElementsAre(Removal::kOutside, Removal::kOutside));
}
TEST(FindRemoved, OverTheGrainFloorHeightTellsWhy) {
  EXPECT_THAT(Remove({{0.2F, 0.3F, 0.6F}, {0.2F, 0.3F, 0.4F}}).why, ElementsAre(Removal::kAboveBin, Removal::kObject));
}
TEST(FindRemoved, WithoutKeptPointsThereIsNoStrip) {
  const cv::Mat points(1, 1, CV_32FC3, cv::Scalar(0.01, 0.3, 0.1));
  EXPECT_THAT(FindRemoved(points, cv::Mat::zeros(1, 1, CV_8UC1), BoxWithPillar()).why, ElementsAre(Removal::kObject));
}
TEST(FindRemoved, TypesAndSizesMustFit) {
  const cv::Mat points(2, 2, CV_32FC3, cv::Scalar::all(0));
  EXPECT_THROW(static_cast<void>(FindRemoved(points, cv::Mat::zeros(2, 3, CV_8UC1), {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(FindRemoved(points, cv::Mat::zeros(2, 2, CV_32FC1), {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(FindRemoved(cv::Mat(2, 2, CV_32FC1), cv::Mat::zeros(2, 2, CV_8UC1), {})),
               std::invalid_argument);
}

}  // namespace
}  // namespace granary
