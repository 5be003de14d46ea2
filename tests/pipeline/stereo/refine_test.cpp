#include "pipeline/stereo/refine.h"

#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>
#include <string>
#include <tuple>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/pipeline/speckle.h"

namespace granary {
namespace {

const cv::Size kSize{320, 240};
constexpr float kInvalid = std::numeric_limits<float>::infinity();

struct Input {
  cv::Mat left, right, truth_px;
};
Input MakeInput(const DisparityPlane& plane, double noise, unsigned seed) {
  const StereoPair pair = RenderPlane(kSize, plane, noise, seed);
  Input in;
  pair.left.convertTo(in.left, CV_32FC1);
  pair.right.convertTo(in.right, CV_32FC1);
  in.truth_px.create(kSize, CV_32FC1);
  for (int y = 0; y < kSize.height; ++y) {
    for (int x = 0; x < kSize.width; ++x) in.truth_px.at<float>(y, x) = static_cast<float>(plane.At(x, y));
  }
  return in;
}

class RefineNoise : public testing::TestWithParam<std::tuple<double, double>> {};

TEST_P(RefineNoise, StatedDeviationIsTheActualError) {
  const auto [noise, slope] = GetParam();
  const DisparityPlane plane{20.3, slope, slope / 2};
  const Input in = MakeInput(plane, noise, 1);
  const Refined refined = RefineDisparity(in.left, in.right, in.truth_px, {});
  double total = 0, squares = 0, variances = 0;
  int n = 0;
  for (int y = 16; y < kSize.height - 16; ++y) {
    for (int x = 64; x < kSize.width - 16; ++x) {
      const double deviation = refined.deviation_px.at<float>(y, x);
      if (!(deviation < 0.29)) continue;  // refined
      const double error = refined.disparity_px.at<float>(y, x) - in.truth_px.at<float>(y, x);
      total += error;
      squares += error * error;
      variances += deviation * deviation;
      ++n;
    }
  }
  // The deviation states noise. The bias of a level plane, 0.01 px, is a term of its own in the volume's budget.
  const double actual = std::sqrt(squares / n - total / n * total / n), stated = std::sqrt(variances / n);
  std::printf("noise %.0f, slope %.2f: error %.4f px, stated %.4f px, ratio %.3f\n", noise, slope, actual, stated,
              actual / stated);
  RecordProperty("ratio", std::to_string(actual / stated));
  EXPECT_GT(n, 0.95 * 208 * 240);
  EXPECT_NEAR(actual / stated, 1, 0.25);
}
INSTANTIATE_TEST_SUITE_P(Noises, RefineNoise,
                         testing::Combine(testing::Values(2.0, 6.0), testing::Values(0.0, 0.05, 0.1)));

TEST(RefineDisparity, StartsUpToHalfAPixelOffComeBack) {
  for (const double off : {-0.5, -0.25, 0.25, 0.5}) {
    const DisparityPlane plane{20.3, 0.05, 0.03};
    const Input in = MakeInput(plane, 2, 1);
    const Refined refined = RefineDisparity(in.left, in.right, in.truth_px + off, {});
    // Two passes leave a few hundredths of the start's error.
    EXPECT_LT(std::abs(CompareWithPlane(refined.disparity_px, plane).bias_px), 0.02) << off;
  }
}

TEST(RefineDisparity, MorePassesDoNotAddNoise) {
  const DisparityPlane plane{20.4, 0.02, 0.01};
  const Input in = MakeInput(plane, 6, 1);
  const auto rms = [&](int passes) {
    return CompareWithPlane(RefineDisparity(in.left, in.right, in.truth_px, {.iterations = passes}).disparity_px, plane)
        .rms_px;
  };
  // From a perfect start one pass carries the noise once, many 1.16 times.
  EXPECT_LT(rms(6), 1.2 * rms(1));
  EXPECT_LT(rms(6), 1.02 * rms(3));
}

TEST(RefineDisparity, BrightnessOfEitherCameraDoesNotMatter) {
  const DisparityPlane plane{20.4, 0.02, 0.01};
  const Input in = MakeInput(plane, 2, 1);
  const cv::Mat plain = RefineDisparity(in.left, in.right, in.truth_px, {}).disparity_px;
  const cv::Mat brighter = RefineDisparity(in.left, in.right * 2.5 + 40, in.truth_px, {}).disparity_px;
  EXPECT_LT(cv::norm(plain, brighter, cv::NORM_INF, (plain < 1e6) & (brighter < 1e6)), 1e-2);  // float rounding
}

TEST(RefineDisparity, InvalidPixelsStayInvalid) {
  Input in = MakeInput({20.3, 0, 0}, 2, 1);
  in.truth_px(cv::Rect(100, 100, 30, 20)).setTo(kInvalid);
  const Refined refined = RefineDisparity(in.left, in.right, in.truth_px, {});
  EXPECT_EQ(cv::countNonZero((refined.disparity_px > 1e6) != (in.truth_px > 1e6)), 0);
  EXPECT_EQ(cv::countNonZero(refined.deviation_px(cv::Rect(100, 100, 30, 20)) > 0), 0);
}

TEST(RefineDisparity, WithoutTextureThePixelKeepsItsDisparityAndSaysSo) {
  const cv::Mat blank(kSize, CV_32FC1, cv::Scalar(80)), start(kSize, CV_32FC1, cv::Scalar(12.25));
  const Refined refined = RefineDisparity(blank, blank, start, {});
  EXPECT_EQ(cv::countNonZero(refined.disparity_px != start), 0);
  EXPECT_EQ(cv::countNonZero(refined.deviation_px != 0.3f), 0);
}

TEST(RefineDisparity, RefusesPicturesOfAnotherTypeOrSize) {
  const cv::Mat good(20, 30, CV_32FC1, cv::Scalar(1)), bytes(20, 30, CV_8UC1, cv::Scalar(1)),
      other(20, 31, CV_32FC1, cv::Scalar(1));
  EXPECT_THROW(static_cast<void>(RefineDisparity(bytes, bytes, good, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(RefineDisparity(good, other, good, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(RefineDisparity(good, good, other, {})), std::invalid_argument);
}

}  // namespace
}  // namespace granary
