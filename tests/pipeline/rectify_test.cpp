// A misaligned pair with distortion, checked against cv::projectPoints, which knows nothing of rectification.
#include "pipeline/rectify.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "pipeline/points.h"

namespace granary {
namespace {

using testing::HasSubstr;

StereoCalibration Misaligned() {
  StereoCalibration c;
  c.image_size = {640, 512};
  c.K1 = {760, 0, 325.4, 0, 758, 250.1, 0, 0, 1};
  c.K2 = {752, 0, 311.8, 0, 751, 262.7, 0, 0, 1};
  c.D1 = {-0.12, 0.05, 0.0007, -0.0004, -0.01};
  c.D2 = {-0.10, 0.03, -0.0005, 0.0006, 0.0};
  cv::Rodrigues(cv::Vec3d(0.012, -0.035, 0.009), c.R);
  c.T_m = {-0.11, 0.003, 0.005};
  return c;
}

StereoCalibration Exchanged(const StereoCalibration& c) {
  StereoCalibration out = c;
  std::swap(out.K1, out.K2);
  std::swap(out.D1, out.D2);
  out.R = c.R.t();
  out.T_m = -(c.R.t() * c.T_m);
  return out;
}

/// Points in the left camera's frame that both cameras see.
std::vector<cv::Point3d> RandomPoints(int count) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<cv::Point3d> points;
  for (int i = 0; i < count; ++i) {
    const double z = 1.0 + 0.3 * unit(random);
    points.emplace_back(0.03 + 0.25 * z * unit(random), 0.25 * z * unit(random), z);
  }
  return points;
}

/// Value of a map between its pixels.
double Bilinear(const cv::Mat& map, double x, double y) {
  const int i = static_cast<int>(std::floor(x)), j = static_cast<int>(std::floor(y));
  const double s = x - i, t = y - j;
  return (1 - t) * ((1 - s) * map.at<float>(j, i) + s * map.at<float>(j, i + 1)) +
         t * ((1 - s) * map.at<float>(j + 1, i) + s * map.at<float>(j + 1, i + 1));
}

TEST(ComputeRectification, BothCamerasSeeAPointInTheSameRow) {
  const StereoCalibration c = Misaligned();
  const Rectification r = ComputeRectification(c);
  const auto points = RandomPoints(500);
  cv::Mat rotation;
  cv::Rodrigues(c.R, rotation);
  std::vector<cv::Point2d> raw_left, raw_right;
  cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), c.K1, c.D1, raw_left);
  cv::projectPoints(points, rotation, c.T_m, c.K2, c.D2, raw_right);
  const RigidTransform rectified_from_left = r.left_from_rectified.inverse();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d p = rectified_from_left * Eigen::Vector3d(points[i].x, points[i].y, points[i].z);
    const double row = r.focal_px * p.y() / p.z() + r.cy_px;
    const double left = r.focal_px * p.x() / p.z() + r.left_cx_px;
    const double right = r.focal_px * (p.x() - r.baseline_m) / p.z() + r.right_cx_px;
    // The maps say where the rectified pixel was taken from; between pixels they are smooth to better than 0.01 px.
    ASSERT_NEAR(Bilinear(r.left_map_x, left, row), raw_left[i].x, 0.01);
    ASSERT_NEAR(Bilinear(r.left_map_y, left, row), raw_left[i].y, 0.01);
    ASSERT_NEAR(Bilinear(r.right_map_x, right, row), raw_right[i].x, 0.01);
    ASSERT_NEAR(Bilinear(r.right_map_y, right, row), raw_right[i].y, 0.01);
    ASSERT_NEAR(r.Disparity_px(p.z()), left - right, 1e-9);
  }
}

TEST(ComputeRectification, KeepsTheBaseline) {
  EXPECT_NEAR(ComputeRectification(Misaligned()).baseline_m, Misaligned().Baseline_m(), 1e-12);
}

TEST(ComputeRectification, MarksWhatTheRawPicturesDoNotReach) {
  const Rectification r = ComputeRectification(Misaligned());
  const int inside = cv::countNonZero(r.left_inside);
  EXPECT_GT(inside, 0.8 * r.size.area());
  EXPECT_LT(inside, r.size.area());
  for (int y = 0; y < r.size.height; ++y) {
    for (int x = 0; x < r.size.width; ++x) {
      if (!r.left_inside.at<std::uint8_t>(y, x)) continue;
      ASSERT_GE(r.left_map_x.at<float>(y, x), 1);
      ASSERT_LE(r.left_map_x.at<float>(y, x), r.size.width - 3);
    }
  }
}

TEST(ComputeRectification, RefusesExchangedSides) {
  EXPECT_THROW(static_cast<void>(ComputeRectification(Exchanged(Misaligned()))), std::invalid_argument);
}

TEST(ComputeRectification, RefusesCamerasOneAboveTheOther) {
  StereoCalibration c = Misaligned();
  c.T_m = {0.003, -0.11, 0.005};
  try {
    static_cast<void>(ComputeRectification(c));
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("side by side"));
  }
}

TEST(Rectification, DepthAndDisparityAreInverse) {
  const Rectification r = ComputeRectification(Misaligned());
  for (const double depth : {0.3, 0.9, 1.7, 25.0}) EXPECT_NEAR(r.Depth_m(r.Disparity_px(depth)), depth, 1e-10 * depth);
}

TEST(Rectification, DepthStepIsTheDerivative) {
  const Rectification r = ComputeRectification(Misaligned());
  const double d = r.Disparity_px(1.1);
  EXPECT_NEAR(r.DepthStep_m(1.1), (r.Depth_m(d - 0.01) - r.Depth_m(d + 0.01)) / 0.02, 1e-8);  // central difference
}

TEST(PointsInWorld, RecoversThePoints) {
  const Rectification r = ComputeRectification(Misaligned());
  RigidTransform world_from_left = RigidTransform::Identity();
  world_from_left.linear() = Eigen::AngleAxisd(3.0, Eigen::Vector3d(1, 0.1, -0.05).normalized()).toRotationMatrix();
  world_from_left.translation() << 0.2, 0.3, 1.2;
  std::mt19937 random(2);
  std::uniform_real_distribution<double> unit(0, 1);
  cv::Mat disparity(40, 50, CV_32FC1);
  for (auto it = disparity.begin<float>(); it != disparity.end<float>(); ++it) {
    *it = static_cast<float>(r.Disparity_px(0.7 + 0.6 * unit(random)));
  }
  const cv::Mat points = PointsInWorld(disparity, r, world_from_left);
  const RigidTransform rectified_from_world = (world_from_left * r.left_from_rectified).inverse();
  for (int y = 0; y < disparity.rows; ++y) {
    for (int x = 0; x < disparity.cols; ++x) {
      const auto& p = points.at<cv::Vec3f>(y, x);
      const Eigen::Vector3d back = rectified_from_world * Eigen::Vector3d(p[0], p[1], p[2]);
      const double z = r.Depth_m(disparity.at<float>(y, x));
      const Eigen::Vector3d truth(z * (x - r.left_cx_px) / r.focal_px, z * (y - r.cy_px) / r.focal_px, z);
      ASSERT_LT((back - truth).norm(), 1e-6 * truth.norm());  // points are stored as floats
    }
  }
}

TEST(PointsInWorld, InvalidAndInfinitelyFarDisparitiesGiveNoPoint) {
  const Rectification r = ComputeRectification(Misaligned());
  const auto at_infinity = static_cast<float>(r.left_cx_px - r.right_cx_px);
  const cv::Mat disparity = (cv::Mat_<float>(1, 3) << std::numeric_limits<float>::infinity(), at_infinity - 5,
                             static_cast<float>(r.Disparity_px(1)));
  const cv::Mat points = PointsInWorld(disparity, r, RigidTransform::Identity());
  EXPECT_TRUE(std::isnan(points.at<cv::Vec3f>(0, 0)[2]));
  EXPECT_TRUE(std::isnan(points.at<cv::Vec3f>(0, 1)[2]));
  EXPECT_TRUE(std::isfinite(points.at<cv::Vec3f>(0, 2)[2]));
}

TEST(PointNoise_m, IsTheDepthStepTimesTheDeviation) {
  const Rectification r = ComputeRectification(Misaligned());
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const cv::Mat disparity =
      (cv::Mat_<float>(1, 2) << static_cast<float>(r.Disparity_px(1.1)), std::numeric_limits<float>::infinity());
  const cv::Mat noise = PointNoise_m(disparity, (cv::Mat_<float>(1, 2) << 0.05f, nan), r);
  EXPECT_NEAR(noise.at<float>(0, 0), 0.05 * r.DepthStep_m(1.1), 1e-7);  // floats
  EXPECT_TRUE(std::isnan(noise.at<float>(0, 1)));
}

// A pair of cameras without distortion, parallel, so that rectification changes nothing.
StereoCalibration Ideal() {
  StereoCalibration c;
  c.image_size = {64, 48};
  c.K1 = c.K2 = {60, 0, 31.5, 0, 60, 23.5, 0, 0, 1};
  c.D1 = c.D2 = {0, 0, 0, 0, 0};
  c.T_m = {-0.1, 0, 0};
  return c;
}
Frame FrameOf(const cv::Mat& image, int bit_depth, const std::string& source) {
  Frame frame;
  frame.image = image;
  frame.bit_depth = bit_depth;
  frame.source = source;
  return frame;
}
FramePair PairOf(const cv::Mat& left, const cv::Mat& right, int bit_depth = 8) {
  FramePair pair;
  pair.left = FrameOf(left, bit_depth, "L.png");
  pair.right = FrameOf(right, bit_depth, "R.png");
  return pair;
}
cv::Mat Grey(int type, double value, cv::Size size = {64, 48}) { return {size, type, cv::Scalar::all(value)}; }

TEST(RectifyPair, GivesGreyLevelsOf255WhateverTheBitDepth) {
  const Rectification r = ComputeRectification(Ideal());
  const cv::Mat eight = RectifyPair(PairOf(Grey(CV_8UC1, 51), Grey(CV_8UC1, 51)), r).left;
  const cv::Mat twelve = RectifyPair(PairOf(Grey(CV_16UC1, 819), Grey(CV_16UC1, 819), 12), r).left;  // 51 · 4095 / 255
  EXPECT_NEAR(eight.at<float>(24, 32), 51, 1e-3);
  EXPECT_NEAR(twelve.at<float>(24, 32), 51, 1e-3);
}

TEST(RectifyPair, TakesTheAmbientLightOff) {
  FramePair pair = PairOf(Grey(CV_8UC1, 120), Grey(CV_8UC1, 110));
  pair.ambient_left = FrameOf(Grey(CV_8UC1, 30), 8, "AL.png");
  pair.ambient_right = FrameOf(Grey(CV_8UC1, 20), 8, "AR.png");
  const RectifiedPair out = RectifyPair(pair, ComputeRectification(Ideal()));
  EXPECT_NEAR(out.left.at<float>(24, 32), 90, 1e-3);
  EXPECT_NEAR(out.right.at<float>(24, 32), 90, 1e-3);
}

TEST(RectifyPair, SaturatedAreasAreUnusableAndSingleFullPixelsAreNot) {
  cv::Mat left = Grey(CV_8UC1, 100);
  left(cv::Rect(10, 10, 20, 20)).setTo(255);
  left.at<std::uint8_t>(24, 50) = 255;
  const RectifiedPair out = RectifyPair(PairOf(left, Grey(CV_8UC1, 100)), ComputeRectification(Ideal()));
  EXPECT_EQ(out.usable.left.at<std::uint8_t>(20, 20), 0);
  EXPECT_EQ(out.usable.left.at<std::uint8_t>(24, 50), 255);
  EXPECT_DOUBLE_EQ(out.saturated_fraction, 401.0 / (64 * 48));
}

TEST(FrameFault, GoodFramesHaveNone) {
  EXPECT_EQ(FrameFault(PairOf(Grey(CV_8UC1, 1), Grey(CV_8UC1, 1)), {64, 48}), "");
  EXPECT_EQ(FrameFault(PairOf(Grey(CV_16UC1, 1), Grey(CV_16UC1, 1), 12), {64, 48}), "");
}

TEST(FrameFault, NamesTheFrameWhatItIsAndWhatIsAllowed) {
  const cv::Mat good = Grey(CV_8UC1, 1);
  const auto fault = [&](const cv::Mat& left, const cv::Mat& right) {
    return FrameFault(PairOf(left, right), {64, 48});
  };
  EXPECT_THAT(fault({}, good), AllOf(HasSubstr("left frame L.png"), HasSubstr("empty")));
  EXPECT_THAT(fault(good, Grey(CV_8UC1, 1, {63, 48})),
              AllOf(HasSubstr("R.png"), HasSubstr("63 x 48"), HasSubstr("64 x 48")));
  EXPECT_THAT(fault(Grey(CV_8UC3, 1), good), HasSubstr("3 channels"));
  EXPECT_THAT(fault(Grey(CV_32FC1, 1), good), HasSubstr("another depth"));
  EXPECT_THAT(fault(good, Grey(CV_16UC1, 1)), AllOf(HasSubstr("16-bit"), HasSubstr("same depth")));
}

TEST(FrameFault, AmbientFramesMustFitAndComeInPairs) {
  FramePair pair = PairOf(Grey(CV_8UC1, 1), Grey(CV_8UC1, 1));
  pair.ambient_left = FrameOf(Grey(CV_8UC1, 1), 8, "AL.png");
  EXPECT_THAT(FrameFault(pair, {64, 48}), HasSubstr("both or none"));
  pair.ambient_right = FrameOf(Grey(CV_16UC1, 1), 8, "AR.png");
  EXPECT_THAT(FrameFault(pair, {64, 48}), HasSubstr("AR.png"));
}

/// Looks straight down from `height_m` over the middle of a bin of 0.52 × 0.355 m.
RigidTransform LookingDown(double height_m) {
  RigidTransform world_from_left = RigidTransform::Identity();
  world_from_left.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal();
  world_from_left.translation() << 0.26, 0.1775, height_m;
  return world_from_left;
}
Bin SmallBin() {
  Bin bin;
  bin.footprint_m = {{0, 0}, {0.52, 0}, {0.52, 0.355}, {0, 0.355}};
  bin.height_m = 0.285;
  return bin;
}

TEST(ProposeRange, CoversFloorAndTop) {
  const Rectification r = ComputeRectification(Misaligned());
  const RangeProposal proposal = ProposeRange(SmallBin(), r, LookingDown(1.1), 256);
  const int high = proposal.range.min_px + proposal.range.count - 1;
  EXPECT_TRUE(proposal.reaches_top);
  EXPECT_LT(proposal.range.min_px, r.Disparity_px(1.1));
  EXPECT_GT(high, r.Disparity_px(1.1 - 0.285));
  EXPECT_LT(proposal.range.count, r.Disparity_px(1.1 - 0.285) - r.Disparity_px(1.1) + 20);  // and not much more
  EXPECT_DOUBLE_EQ(proposal.nearest_m, r.Depth_m(high));
}

TEST(ProposeRange, SaysWhenTheTopIsTooNear) {
  const Rectification r = ComputeRectification(Misaligned());
  const RangeProposal proposal = ProposeRange(SmallBin(), r, LookingDown(1.1), 24);
  EXPECT_FALSE(proposal.reaches_top);
  EXPECT_EQ(proposal.range.count, 24);
  EXPECT_GT(proposal.nearest_m, 1.1 - 0.285);
  EXPECT_LT(proposal.range.min_px, r.Disparity_px(1.1));  // the floor is searched all the same
}

TEST(ProposeRange, ACameraBelowTheTopCannotReachIt) {
  EXPECT_FALSE(ProposeRange(SmallBin(), ComputeRectification(Misaligned()), LookingDown(0.25), 256).reaches_top);
}

TEST(ProposeRange, RefusesAFloorBehindTheCameras) {
  EXPECT_THROW(static_cast<void>(ProposeRange(SmallBin(), ComputeRectification(Misaligned()), LookingDown(-1), 256)),
               std::invalid_argument);
}

}  // namespace
}  // namespace granary
