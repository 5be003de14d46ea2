#include "pipeline/stereo/agreement.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/pipeline/speckle.h"

namespace granary {
namespace {

cv::Mat Grey(const cv::Mat& picture) {
  cv::Mat grey;
  picture.convertTo(grey, CV_32FC1);
  return grey;
}

struct Pair {
  cv::Mat left, right;
};
Pair Plane(double disparity_px, double noise) {
  const StereoPair pair = RenderPlane({120, 60}, {disparity_px, 0, 0}, noise, 1);
  return {Grey(pair.left), Grey(pair.right)};
}

TEST(ExplainedContrast, IsAllOfItForTheSameWindowWhateverGainAndOffset) {
  const Pair pair = Plane(10, 0);
  EXPECT_NEAR(ExplainedContrast(pair.left, 3 * pair.right + 40, 60, 30, 10, 4, 3), 1, 0.005);  // rounded to 8 bits
}

TEST(ExplainedContrast, ReadsBetweenColumns) {
  const Pair pair = Plane(10.5, 0);
  // the straight line between two columns flattens dots 2.2 px wide
  EXPECT_GT(ExplainedContrast(pair.left, pair.right, 60, 30, 10.5, 4, 3), 0.95);
  EXPECT_LT(ExplainedContrast(pair.left, pair.right, 60, 30, 12.5, 4, 3), 0.5);
}

TEST(ExplainedContrast, IsTheShareOfSignalUnderNoise) {
  std::mt19937 random(3);
  std::normal_distribution<float> normal(0, 1);
  cv::Mat left(101, 140, CV_32FC1), right(101, 140, CV_32FC1);
  for (int y = 0; y < left.rows; ++y) {
    for (int x = 0; x < left.cols; ++x) {
      const float common = normal(random);
      left.at<float>(y, x) = common + normal(random);
      right.at<float>(y, x) = common + normal(random);
    }
  }
  // correlation 1/2; 101 x 101 pixels leave it uncertain by 0.01
  EXPECT_NEAR(ExplainedContrast(left, right, 70, 50, 0, 50, 50), 0.25, 0.03);
}

TEST(ExplainedContrast, IsNothingForOppositePictures) {
  const Pair pair = Plane(10, 0);
  EXPECT_EQ(ExplainedContrast(pair.left, -pair.right, 60, 30, 10, 4, 3), 0);
}

TEST(ExplainedContrast, IsNothingWhereAWindowIsFlat) {
  const Pair pair = Plane(10, 0);
  const cv::Mat flat(pair.left.size(), CV_32FC1, cv::Scalar(200));
  EXPECT_EQ(ExplainedContrast(flat, pair.right, 60, 30, 10, 4, 3), 0);
  EXPECT_EQ(ExplainedContrast(pair.left, flat, 60, 30, 10, 4, 3), 0);
}

TEST(ExplainedContrast, IsNothingWhereTheRightWindowLeavesThePicture) {
  const Pair pair = Plane(10, 0);
  EXPECT_EQ(ExplainedContrast(pair.left, pair.right, 12, 30, 10, 4, 3), 0);
  EXPECT_EQ(ExplainedContrast(pair.left, pair.right, 60, 30, -56, 4, 3), 0);
  EXPECT_GT(ExplainedContrast(pair.left, pair.right, 15, 30, 10, 4, 3), 0.9);
}

TEST(ExplainedContrast, IsCutAtTheLeftPicturesBorder) {
  const Pair pair = Plane(-5, 0);
  EXPECT_GT(ExplainedContrast(pair.left, pair.right, 0, 0, -5, 4, 3), 0.9);
}

}  // namespace
}  // namespace granary
