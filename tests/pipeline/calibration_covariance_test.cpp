// Covariances of simulated board calibrations; that they are true to the scatter is calibration_scatter_test's matter.
#include "pipeline/calibration_covariance.h"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Core>
#include <opencv2/core.hpp>

#include "pipeline/calibration_file.h"
#include "pipeline/reference.h"
#include "tests/pipeline/simulated_boards.h"
#include "tests/pipeline/temporary_folder.h"

namespace granary {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr int kFx1 = 0, kK3OfLeft = 8, kTx = 21;  // in the order of LabPair, with five coefficients a camera

cv::Mat CovarianceOf(const BoardViews& views) {
  return StereoCovariance(LabPair(), views.object_points, views.left, views.right);
}
double Deviation(const cv::Mat& covariance, int parameter) {
  return std::sqrt(covariance.at<double>(parameter, parameter));
}
std::string RefusalOf(const BoardViews& views) {
  try {
    static_cast<void>(CovarianceOf(views));
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Moved, AddsToEveryParameterInOrder) {
  const StereoCalibration before = LabPair();
  Eigen::VectorXd step(before.ParameterCount());
  for (int i = 0; i < step.size(); ++i) step[i] = 1e-3 * (i + 1);
  step.segment<3>(18).setZero();
  const StereoCalibration after = Moved(before, step);
  EXPECT_DOUBLE_EQ(after.K1(0, 0), before.K1(0, 0) + 0.001);
  EXPECT_DOUBLE_EQ(after.K1(1, 1), before.K1(1, 1) + 0.002);
  EXPECT_DOUBLE_EQ(after.K1(0, 2), before.K1(0, 2) + 0.003);
  EXPECT_DOUBLE_EQ(after.K1(1, 2), before.K1(1, 2) + 0.004);
  EXPECT_DOUBLE_EQ(after.D1[4], before.D1[4] + 0.009);
  EXPECT_DOUBLE_EQ(after.K2(0, 0), before.K2(0, 0) + 0.010);
  EXPECT_DOUBLE_EQ(after.D2[0], before.D2[0] + 0.014);
  EXPECT_EQ(after.R, before.R);
  EXPECT_DOUBLE_EQ(after.T_m[2], before.T_m[2] + 0.024);
}

TEST(Moved, TurnsTheRotationFromTheLeft) {
  const StereoCalibration before = LabPair();
  Eigen::VectorXd step = Eigen::VectorXd::Zero(before.ParameterCount());
  step.segment<3>(18) << 0.01, -0.02, 0.03;
  cv::Matx33d turn;
  cv::Rodrigues(cv::Vec3d(0.01, -0.02, 0.03), turn);
  EXPECT_LT(cv::norm(Moved(before, step).R - turn * before.R), 1e-15);  // rounding
}

TEST(Moved, RefusesAStepOfAnotherLength) {
  EXPECT_THROW(static_cast<void>(Moved(LabPair(), Eigen::VectorXd::Zero(23))), std::invalid_argument);
}

TEST(StereoCovariance, GrowsWithTheSquareOfTheNoise) {
  const BoardViews views = SimulatedBoards(LabPair(), 8, 1);
  const cv::Mat one = CovarianceOf(Noisy(views, 0.1, 2)), two = CovarianceOf(Noisy(views, 0.2, 2));
  // The residuals double; what is left is their curvature over a tenth of a pixel, and the corners' floats.
  for (const int i : {kFx1, 4, kTx}) EXPECT_NEAR(Deviation(two, i) / Deviation(one, i), 2, 0.01);
}

TEST(StereoCovariance, ShrinksWithTheNumberOfViews) {
  const cv::Mat few = CovarianceOf(Noisy(SimulatedBoards(LabPair(), 8, 1), 0.1, 2));
  const cv::Mat many = CovarianceOf(Noisy(SimulatedBoards(LabPair(), 32, 1), 0.1, 2));
  // Four times the views halve it; views differ in what they are worth.
  EXPECT_LT(Deviation(many, kFx1), 0.75 * Deviation(few, kFx1));
}

TEST(StereoCovariance, HoldsCoefficientsThatAreZero) {
  const cv::Mat covariance = CovarianceOf(Noisy(SimulatedBoards(LabPair(), 8, 1), 0.1, 2));
  EXPECT_EQ(cv::countNonZero(covariance.row(kK3OfLeft)), 0);
  EXPECT_EQ(cv::countNonZero(covariance.col(kK3OfLeft)), 0);
  EXPECT_GT(Deviation(covariance, kK3OfLeft - 1), 0);
}

TEST(StereoCovariance, PassesThroughItsFile) {
  StereoCalibration calibration = LabPair();
  calibration.covariance = CovarianceOf(Noisy(SimulatedBoards(LabPair(), 8, 1), 0.1, 2));
  const TemporaryFolder folder;
  SaveStereoCalibration(folder / "stereo.yml", calibration);
  const cv::Mat back = LoadStereoCalibration(folder / "stereo.yml").covariance;
  ASSERT_EQ(back.size(), calibration.covariance.size());
  EXPECT_EQ(cv::norm(back, calibration.covariance, cv::NORM_INF), 0);
}

TEST(HashOfRig, IsBlindToTheCovariance) {
  StereoCalibration calibration = LabPair();
  const std::string before = HashOfRig(calibration, RigidTransform::Identity());
  calibration.covariance = cv::Mat::eye(24, 24, CV_64F);
  EXPECT_EQ(HashOfRig(calibration, RigidTransform::Identity()), before);
}

TEST(StereoCovariance, RefusesTwoViews) {
  EXPECT_THAT(RefusalOf(SimulatedBoards(LabPair(), 2, 1)), AllOf(HasSubstr("2"), HasSubstr("at least 3")));
}

TEST(StereoCovariance, RefusesOneViewShownAgainAndAgain) {
  BoardViews views = SimulatedBoards(LabPair(), 1, 1);
  for (int i = 0; i < 7; ++i) {
    views.object_points.push_back(views.object_points[0]);
    views.left.push_back(views.left[0]);
    views.right.push_back(views.right[0]);
  }
  EXPECT_THAT(RefusalOf(Noisy(views, 0.1, 2)), AllOf(HasSubstr("open"), HasSubstr("tilted")));
}

TEST(StereoCovariance, RefusesBoardsThatNeverTilt) {
  EXPECT_THAT(RefusalOf(Noisy(SimulatedBoards(LabPair(), 8, 1, 0.0), 0.1, 2)), HasSubstr("open"));
}

TEST(StereoCovariance, RefusesCountsThatDiffer) {
  BoardViews views = SimulatedBoards(LabPair(), 4, 1);
  views.right.pop_back();
  EXPECT_THAT(RefusalOf(views), HasSubstr("4 left and 3 right"));
  views = SimulatedBoards(LabPair(), 4, 1);
  views.left[2].pop_back();
  EXPECT_THAT(RefusalOf(views), AllOf(HasSubstr("view 3"), HasSubstr("53 in the left")));
}

TEST(StereoCovariance, RefusesCornersThatAreNoNumbers) {
  BoardViews views = SimulatedBoards(LabPair(), 4, 1);
  views.right[1][7].y = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THAT(RefusalOf(views), AllOf(HasSubstr("view 2"), HasSubstr("finite")));
}

TEST(StereoCovariance, RefusesCornersOnALine) {
  BoardViews views = SimulatedBoards(LabPair(), 4, 1);
  views.object_points[3].resize(9);  // the board's first row
  views.left[3].resize(9);
  views.right[3].resize(9);
  EXPECT_THAT(RefusalOf(views), AllOf(HasSubstr("view 4"), HasSubstr("line")));
}

TEST(StereoCovariance, RefusesThreeCorners) {
  BoardViews views = SimulatedBoards(LabPair(), 4, 1);
  views.object_points[0].resize(3);
  views.left[0].resize(3);
  views.right[0].resize(3);
  EXPECT_THAT(RefusalOf(views), AllOf(HasSubstr("view 1"), HasSubstr("at least 4")));
}

}  // namespace
}  // namespace granary
