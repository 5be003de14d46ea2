// Contour lines lie where the values cross the level, whole and in one piece.
#include <cmath>
#include <limits>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "pipeline/contours.h"

namespace granary {
namespace {

using testing::DoubleNear;
using testing::IsEmpty;
using testing::Pointwise;

/// 100 - distance from (50, 40), 101 x 81 px.
cv::Mat Cone() {
  cv::Mat values(81, 101, CV_32FC1);
  for (int y = 0; y < values.rows; ++y) {
    for (int x = 0; x < values.cols; ++x) {
      values.at<float>(y, x) = static_cast<float>(100 - std::hypot(x - 50, y - 40));
    }
  }
  return values;
}

TEST(TraceContours, AConeGivesOneClosedCircle) {
  const auto lines = TraceContours(Cone(), 70);
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_TRUE(lines[0].closed);
  EXPECT_GT(lines[0].points_px.size(), 150U);  // a circle of radius 30 crosses some 8 r sides
  // A straight line between pixel centres replaces a cone: less than 1 / (8 r) px at r = 30, times 2 for the diagonal.
  for (const cv::Point2f& p : lines[0].points_px) EXPECT_NEAR(std::hypot(p.x - 50, p.y - 40), 30, 0.01);
}
TEST(TraceContours, NeighboursInALineAreNeighboursInThePicture) {
  const auto lines = TraceContours(Cone(), 70);
  ASSERT_EQ(lines.size(), 1U);
  const auto& points = lines[0].points_px;
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_LT(cv::norm(points[i] - points[(i + 1) % points.size()]), std::sqrt(2.0) + 1e-6);  // a cell's diagonal
  }
}
TEST(TraceContours, ALineToTheRimIsOpen) {
  const cv::Mat ramp = (cv::Mat_<float>(3, 3) << 0, 1, 2, 0, 1, 2, 0, 1, 2);
  const auto lines = TraceContours(ramp, 0.25);
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_FALSE(lines[0].closed);
  ASSERT_EQ(lines[0].points_px.size(), 3U);
  for (const cv::Point2f& p : lines[0].points_px) EXPECT_FLOAT_EQ(p.x, 0.25F);
}
TEST(TraceContours, LinesEndAtValuesThatAreNotFinite) {
  cv::Mat ramp = cv::Mat(9, 4, CV_32FC1);
  for (int x = 0; x < 4; ++x) ramp.col(x).setTo(x);
  ramp.row(4).setTo(std::numeric_limits<float>::quiet_NaN());
  const auto lines = TraceContours(ramp, 1.5);
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_EQ(lines[0].points_px.size(), 4U);
  EXPECT_EQ(lines[1].points_px.size(), 4U);
}
TEST(TraceContours, ASaddleHasTwoLines) {
  EXPECT_EQ(TraceContours((cv::Mat_<float>(2, 2) << 1, 0, 0, 1), 0.4).size(), 2U);
  EXPECT_EQ(TraceContours((cv::Mat_<float>(2, 2) << 1, 0, 0, 1), 0.6).size(), 2U);
}
TEST(TraceContours, ALevelNobodyCrossesHasNoLine) { EXPECT_THAT(TraceContours(Cone(), 500), IsEmpty()); }
TEST(TraceContours, OtherTypesAreRefused) {
  EXPECT_THROW(static_cast<void>(TraceContours(cv::Mat(3, 3, CV_8UC1), 1)), std::invalid_argument);
}

TEST(ChooseContourLevels, AreRoundAndInside) {
  const ContourLevels chosen = ChooseContourLevels(0.031, 0.165, 8, 0);
  EXPECT_DOUBLE_EQ(chosen.interval, 0.02);
  EXPECT_THAT(chosen.levels, Pointwise(DoubleNear(1e-12), {0.04, 0.06, 0.08, 0.10, 0.12, 0.14, 0.16}));
}
TEST(ChooseContourLevels, NoiseMakesThemFewer) {
  EXPECT_THAT(ChooseContourLevels(0.031, 0.165, 8, 0.04).levels, Pointwise(DoubleNear(1e-12), {0.05, 0.10, 0.15}));
}
TEST(ChooseContourLevels, LessThanAnIntervalHasNone) {
  EXPECT_THAT(ChooseContourLevels(0.099, 0.102, 8, 0.004).levels, IsEmpty());
  EXPECT_THAT(ChooseContourLevels(3, 3, 8, 0).levels, IsEmpty());
}

}  // namespace
}  // namespace granary
