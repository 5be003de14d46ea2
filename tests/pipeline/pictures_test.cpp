// Pictures of what a camera saw show what they are given where they should: checked by looking at single pixels.
#include <array>
#include <limits>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "pipeline/pictures.h"
#include "pipeline/plot.h"

namespace granary {
namespace {

using testing::DoubleNear;
using testing::Pointwise;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// Every colour that occurs.
std::set<std::array<int, 3>> Colours(const cv::Mat& picture) {
  std::set<std::array<int, 3>> colours;
  for (const cv::Vec3b& pixel : cv::Mat_<cv::Vec3b>(picture)) colours.insert({pixel[0], pixel[1], pixel[2]});
  return colours;
}

int CountOf(const cv::Mat& picture, const cv::Vec3b& colour) {
  cv::Mat mask;
  cv::inRange(picture, colour, colour, mask);
  return cv::countNonZero(mask);
}

TEST(RoundTicks, AreRoundAndInside) {
  EXPECT_THAT(RoundTicks(0, 0.52, 5), Pointwise(DoubleNear(1e-12), {0.0, 0.2, 0.4}));
  EXPECT_THAT(RoundTicks(-0.013, 0.533, 9), Pointwise(DoubleNear(1e-12), {0.0, 0.1, 0.2, 0.3, 0.4, 0.5}));
  EXPECT_THAT(RoundTicks(583.2, 681.9, 8), Pointwise(DoubleNear(1e-9), {600.0, 620.0, 640.0, 660.0, 680.0}));
}
TEST(RoundTicks, ARangeOfNothingHasOneTick) { EXPECT_EQ(RoundTicks(3, 3, 5).size(), 1U); }

TEST(Colourise, NotFiniteIsGrey) {
  const cv::Mat picture =
      Colourise((cv::Mat_<float>(1, 3) << 0, kNan, std::numeric_limits<float>::infinity()), {0, 1, "", 0});
  EXPECT_EQ(picture.at<cv::Vec3b>(0, 1), cv::Vec3b(205, 205, 205));
  EXPECT_EQ(picture.at<cv::Vec3b>(0, 2), cv::Vec3b(205, 205, 205));
  EXPECT_NE(picture.at<cv::Vec3b>(0, 0), cv::Vec3b(205, 205, 205));
}
TEST(Colourise, ValuesBeyondTheBarTakeItsEnds) {
  const cv::Mat picture = Colourise((cv::Mat_<float>(1, 4) << -9, 0, 1, 9), {0, 1, "", cv::COLORMAP_VIRIDIS});
  EXPECT_EQ(picture.at<cv::Vec3b>(0, 0), picture.at<cv::Vec3b>(0, 1));
  EXPECT_EQ(picture.at<cv::Vec3b>(0, 2), picture.at<cv::Vec3b>(0, 3));
}

TEST(DisparityPicture, InvalidPixelsAreGrey) {
  cv::Mat disparity(1024, 1280, CV_32FC1, cv::Scalar(150));
  disparity(cv::Rect(0, 0, 640, 1024)).setTo(std::numeric_limits<float>::infinity());
  EXPECT_GT(CountOf(DisparityPicture(disparity, "t"), {205, 205, 205}), 600'000);
}
TEST(DisparityPicture, AMapWithoutOneValidPixelIsDrawn) {
  const cv::Mat disparity(20, 30, CV_32FC1, cv::Scalar(std::numeric_limits<float>::infinity()));
  EXPECT_FALSE(DisparityPicture(disparity, "nothing").empty());
}
TEST(DisparityPicture, OtherTypesAreRefused) {
  EXPECT_THROW(static_cast<void>(DisparityPicture(cv::Mat(3, 3, CV_16SC1, cv::Scalar(0)), "t")), std::invalid_argument);
}

TEST(RectifiedPicture, HasALineEvery64Rows) {
  const cv::Mat grey(256, 300, CV_32FC1, cv::Scalar(100));
  const cv::Mat picture = RectifiedPicture(grey, grey);
  EXPECT_EQ(picture.at<cv::Vec3b>(52 + 64, 90 + 30), cv::Vec3b(60, 180, 255));
  EXPECT_EQ(picture.at<cv::Vec3b>(52 + 128, 90 + 430), cv::Vec3b(80, 220, 80));
}
TEST(RectifiedPicture, ABlackPairIsDrawn) {
  const cv::Mat black(64, 64, CV_8UC1, cv::Scalar(0));
  EXPECT_FALSE(RectifiedPicture(black, black).empty());
}
TEST(RectifiedPicture, SizesMustAgree) {
  EXPECT_THROW(
      static_cast<void>(RectifiedPicture(cv::Mat(4, 4, CV_8UC1, cv::Scalar(0)), cv::Mat(4, 5, CV_8UC1, cv::Scalar(0)))),
      std::invalid_argument);
}

TEST(MaskPicture, TintsTheGrainOnly) {
  const cv::Mat grey(700, 700, CV_8UC1, cv::Scalar(100));
  cv::Mat mask = cv::Mat::zeros(700, 700, CV_8UC1);
  mask.colRange(350, 700).setTo(255);
  const cv::Mat picture = MaskPicture(grey, mask, "t");
  const cv::Vec3b scene = picture.at<cv::Vec3b>(400, 200), grain = picture.at<cv::Vec3b>(400, 600);
  EXPECT_EQ(scene[0], scene[2]);
  EXPECT_GT(grain[2], grain[0] + 50);
}
TEST(MaskPicture, SizesMustAgree) {
  EXPECT_THROW(
      static_cast<void>(MaskPicture(cv::Mat(4, 4, CV_8UC1, cv::Scalar(0)), cv::Mat(5, 5, CV_8UC1, cv::Scalar(0)), "t")),
      std::invalid_argument);
}
TEST(AppendLegend, ShowsEveryColourBelowThePicture) {
  const cv::Mat picture(40, 500, CV_8UC3, cv::Scalar(0, 0, 0));
  const std::vector<LegendEntry> entries{{{10, 20, 30}, "one"}, {{200, 100, 50}, "two"}};
  const cv::Mat legend = AppendLegend(picture, entries);
  EXPECT_GT(legend.rows, picture.rows);
  EXPECT_GT(CountOf(legend, {30, 20, 10}), 100);
  EXPECT_GT(CountOf(legend, {50, 100, 200}), 100);
}
TEST(AppendLegend, IsWidenedOnBothSides) {
  const cv::Mat picture(40, 50, CV_8UC3, cv::Scalar(0, 0, 0));
  const std::vector<LegendEntry> entries{{{10, 20, 30}, std::string(40, 'W')}};
  const cv::Mat legend = AppendLegend(picture, entries);
  EXPECT_EQ(legend.at<cv::Vec3b>(20, 0), cv::Vec3b(255, 255, 255));
  EXPECT_EQ(legend.at<cv::Vec3b>(20, legend.cols / 2), cv::Vec3b(0, 0, 0));
  EXPECT_EQ(legend.at<cv::Vec3b>(20, legend.cols - 1), cv::Vec3b(255, 255, 255));
}
TEST(FramePlot, IsWidenedForALongTitle) {
  const cv::Mat body(50, 50, CV_8UC3, cv::Scalar(0, 0, 0));
  EXPECT_GT(FramePlot(body, std::string(60, 'W'), std::nullopt, std::nullopt, std::nullopt).cols, 600);
  EXPECT_GT(Colours(FramePlot(body, "title", std::nullopt, std::nullopt, std::nullopt)).size(), 2U);
}

}  // namespace
}  // namespace granary
