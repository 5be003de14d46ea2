#include "pipeline/shots.h"

#include <cmath>
#include <limits>
#include <stdexcept>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

namespace granary {
namespace {

const cv::Size kSize{40, 30};
constexpr float kNone = std::numeric_limits<float>::infinity();

cv::Mat Even(float value) { return cv::Mat(kSize, CV_32FC1, cv::Scalar(value)); }

TEST(FuseDisparities, AveragesTheShotsAndTheirNoise) {
  const FusedDisparities fused =
      FuseDisparities({Even(20.0f), Even(20.2f), Even(20.1f), Even(20.1f)}, std::vector<cv::Mat>(4, Even(0.04f)));
  EXPECT_NEAR(fused.disparity_px.at<float>(10, 10), 20.1f, 1e-5);  // floats
  EXPECT_NEAR(fused.deviation_px.at<float>(10, 10), 0.02f, 1e-7);  // σ / √4
  EXPECT_EQ(cv::countNonZero(fused.moved), 0);
}

TEST(FuseDisparities, AMinorityThatSawAPixelMakesNone) {
  cv::Mat holed = Even(20);
  holed.at<float>(5, 5) = kNone;
  const std::vector<cv::Mat> deviations(3, Even(0.04f));
  EXPECT_EQ(FuseDisparities({holed, Even(20), Even(20)}, deviations).disparity_px.at<float>(5, 5), 20.0f);
  const FusedDisparities rare = FuseDisparities({holed, holed, Even(20)}, deviations);
  EXPECT_EQ(rare.disparity_px.at<float>(5, 5), kNone);
  EXPECT_TRUE(std::isnan(rare.deviation_px.at<float>(5, 5)));
}

TEST(FuseDisparities, WhatMovedIsMarkedAndNeverAveraged) {
  cv::Mat with_person = Even(20);
  with_person(cv::Rect(8, 8, 12, 14)).setTo(24);
  const FusedDisparities fused = FuseDisparities({Even(20), with_person}, {Even(0.04f), Even(0.04f)});
  EXPECT_EQ(cv::countNonZero(fused.moved), 12 * 14);
  EXPECT_EQ(fused.disparity_px.at<float>(12, 12), kNone);
  EXPECT_EQ(fused.disparity_px.at<float>(2, 2), 20.0f);
}

TEST(FuseDisparities, StrayMatchesAreNoMotion) {
  cv::Mat stray = Even(20);
  stray(cv::Rect(8, 8, 3, 14)).setTo(24);
  EXPECT_EQ(cv::countNonZero(FuseDisparities({Even(20), stray}, {Even(0.04f), Even(0.04f)}).moved), 0);
}

TEST(FuseDisparities, AnUnsureMatchMayDifferMore) {
  EXPECT_EQ(cv::countNonZero(FuseDisparities({Even(20), Even(22)}, {Even(0.5f), Even(0.5f)}).moved), 0);
}

TEST(FuseDisparities, RefusesNothingAndWhatDoesNotFit) {
  EXPECT_THROW((void)FuseDisparities({}, {}), std::invalid_argument);
  EXPECT_THROW((void)FuseDisparities({Even(1)}, {}), std::invalid_argument);
  EXPECT_THROW((void)FuseDisparities({Even(1)}, {cv::Mat(3, 3, CV_32FC1)}), std::invalid_argument);
}

TEST(RelativeDeviation_percent, IsOfTheMean) {
  EXPECT_NEAR(RelativeDeviation_percent({9, 10, 11}), 10, 1e-12);
  EXPECT_TRUE(std::isnan(RelativeDeviation_percent({9})));
  EXPECT_TRUE(std::isnan(RelativeDeviation_percent({-1, 1})));
}

}  // namespace
}  // namespace granary
