// Disparities of slanted planes under synthetic speckle. Every bound is about 1.5 times what was measured when the test
// was written; the measured value stands beside it.
#include "pipeline/stereo/match.h"

#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <opencv2/core.hpp>

#include "tests/pipeline/speckle.h"

namespace granary {
namespace {

const cv::Size kSize{320, 240};
constexpr DisparityRange kRange{8, 48};
constexpr DisparityPlane kSlanted{20.3, 0.05, 0.03}, kSteep{38.1, -0.07, 0.02};

DisparityError Measure(const DisparityPlane& plane, double noise, const StereoOptions& options = {}) {
  const StereoPair pair = RenderPlane(kSize, plane, noise, 1);
  const DisparityError error =
      CompareWithPlane(MatchStereo(pair.left, pair.right, kRange, options).disparity_px, plane);
  char text[200];
  std::snprintf(text, sizeof text, "bias %+.5f px, rms %.4f px, locking %.4f px, valid %.4f, outliers %.5f",
                error.bias_px, error.rms_px, error.locking_px, error.valid_share, error.outlier_share);
  std::printf("noise %.0f, plane %.2f %+.3f x %+.3f y: %s\n", noise, plane.d0, plane.slope_x, plane.slope_y, text);
  testing::Test::RecordProperty("error", text);
  return error;
}

void ExpectWithin(const DisparityError& error, const DisparityError& bound) {
  EXPECT_LT(std::abs(error.bias_px), bound.bias_px);
  EXPECT_LT(error.rms_px, bound.rms_px);
  EXPECT_LT(error.locking_px, bound.locking_px);
  EXPECT_GT(error.valid_share, bound.valid_share);
  EXPECT_LT(error.outlier_share, bound.outlier_share);
}

// Measured: bias −0.0005, rms 0.0138, locking 0.0095 px, outliers 0.03 %.
TEST(MatchStereo, SlantedPlaneAtLowNoise) { ExpectWithin(Measure(kSlanted, 2), {0.002, 0.021, 0.016, 0.99, 0.001}); }
// Measured: bias −0.0016, rms 0.0357, locking 0.0118 px, outliers 0.13 %.
TEST(MatchStereo, SlantedPlaneAtHighNoise) { ExpectWithin(Measure(kSlanted, 6), {0.0035, 0.056, 0.018, 0.99, 0.0032}); }
// Measured: bias +0.0007, rms 0.0144, locking 0.0013 px, outliers 0.05 %.
TEST(MatchStereo, SteepPlaneAtLowNoise) { ExpectWithin(Measure(kSteep, 2), {0.002, 0.021, 0.016, 0.99, 0.001}); }
// Measured: bias +0.0023, rms 0.0371, locking 0.0033 px, outliers 0.21 %.
TEST(MatchStereo, SteepPlaneAtHighNoise) { ExpectWithin(Measure(kSteep, 6), {0.0035, 0.056, 0.018, 0.99, 0.0032}); }

TEST(MatchStereo, LevelPlanesAreNotPulledToWholeDisparities) {
  // Nothing averages over fractions here: what is left is a constant error of the height.
  for (const double d0 : {20.05, 20.25, 20.4, 20.5, 20.6, 20.75, 20.95}) {
    EXPECT_LT(std::abs(Measure({d0, 0, 0}, 2).bias_px), 0.015) << d0;  // measured: 0.0104 at 20.25
  }
}

TEST(MatchStereo, RefinementRemovesTheLockingOfTheInterpolant) {
  const double raw_px = Measure(kSlanted, 2, {.refine_radius_px = 0}).locking_px;
  EXPECT_LT(Measure(kSlanted, 2).locking_px, raw_px / 4);
}

TEST(MatchStereo, SixteenBitPicturesGiveTheSameAsEightBit) {
  const StereoPair pair = RenderPlane(kSize, kSlanted, 2, 1);
  cv::Mat left, right;
  pair.left.convertTo(left, CV_16UC1, 16);
  pair.right.convertTo(right, CV_16UC1, 16);
  const cv::Mat eight = MatchStereo(pair.left, pair.right, kRange, {}).disparity_px;
  const cv::Mat sixteen = MatchStereo(left, right, kRange, {}).disparity_px;
  const cv::Mat valid = (eight < 1e6) & (sixteen < 1e6);
  EXPECT_EQ(cv::countNonZero((eight < 1e6) != (sixteen < 1e6)), 0);
  EXPECT_LT(cv::norm(eight, sixteen, cv::NORM_INF, valid), 1e-3);  // float sums of scaled numbers
}

TEST(MatchStereo, ThreadsDoNotChangeTheResult) {
  const StereoPair pair = RenderPlane({200, 150}, kSlanted, 2, 1);
  const auto with_threads = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return MatchStereo(pair.left, pair.right, kRange, {});
  };
  const StereoResult one = with_threads(1), four = with_threads(4);
  EXPECT_EQ(cv::countNonZero(one.disparity_px != four.disparity_px), 0);
  EXPECT_EQ(cv::countNonZero((one.deviation_px != four.deviation_px) & (one.disparity_px < 1e6)), 0);
}

// A box in front of a level ground: columns from kEdge on are nearer.
TEST(MatchStereo, AStepIsFoundWhereItIs) {
  constexpr int kEdge = 160;
  constexpr double kFar = 16.3, kNear = 28.6;
  const Speckle far(kSize, 1), near(kSize, 2);
  const cv::Mat left = Render(kSize, 2, 3, [&](int x, int y) { return x >= kEdge ? near.At(x, y) : far.At(x, y); });
  const cv::Mat right = Render(
      kSize, 2, 4, [&](int x, int y) { return x + kNear >= kEdge ? near.At(x + kNear, y) : far.At(x + kFar, y); });
  const cv::Mat disparity = MatchStereo(left, right, kRange, {}).disparity_px;
  int wrong = 0, far_valid = 0, occluded_valid = 0;
  for (int y = 16; y < 224; ++y) {
    for (int x = 60; x < 304; ++x) {
      const float d = disparity.at<float>(y, x);
      if (!std::isfinite(d)) continue;
      const bool occluded = x < kEdge && x - kFar + kNear >= kEdge;  // the left picture alone sees it
      far_valid += x < kEdge - 13 && !occluded;
      occluded_valid += occluded;
      // Within half a census and half a refinement window of the edge a window sees both.
      if (std::abs(x - kEdge) > 14) wrong += std::abs(d - (x < kEdge ? kFar : kNear)) > 0.3;
    }
  }
  EXPECT_LT(wrong, 0.0035 * 208 * 244);         // measured: 0.23 % of the pixels
  EXPECT_GT(far_valid, 0.97 * 208 * 87);        // the ground keeps its points
  EXPECT_LT(occluded_valid, 0.5 * 208 * 12.3);  // most of what one camera alone sees is left out
}

TEST(MatchStereo, PicturesWithoutTextureMatchNowhere) {
  for (const int grey : {0, 255}) {
    const cv::Mat blank(kSize, CV_8UC1, cv::Scalar(grey));
    const StereoResult result = MatchStereo(blank, blank, kRange, {});
    EXPECT_EQ(cv::countNonZero(result.disparity_px < 1e6), 0) << grey;
    EXPECT_EQ(cv::countNonZero(result.deviation_px == result.deviation_px), 0) << grey;  // NaN everywhere
  }
}

TEST(MatchStereo, ASaturatedPatchIsInvalidOnlyWhereItIs) {
  StereoPair pair = RenderPlane(kSize, kSlanted, 2, 1);
  const cv::Rect patch(140, 90, 60, 50);
  pair.left(patch).setTo(255);
  for (int y = patch.y; y < patch.y + patch.height; ++y) {
    for (int x = 0; x < kSize.width; ++x) {
      const double source = kSlanted.LeftColumn(x, y);
      if (source >= patch.x && source < patch.x + patch.width) pair.right.at<std::uint8_t>(y, x) = 255;
    }
  }
  const cv::Mat disparity = MatchStereo(pair.left, pair.right, kRange, {}).disparity_px;
  // Half a census window inside the patch there is nothing to compare.
  const cv::Rect inside(patch.x + 4, patch.y + 3, patch.width - 8, patch.height - 6);
  EXPECT_EQ(cv::countNonZero(disparity(inside) < 1e6), 0);
  int lost = 0, seen = 0;
  for (int y = 16; y < 224; ++y) {
    for (int x = 64; x < 304; ++x) {
      if (cv::Rect(patch.x - 12, patch.y - 12, patch.width + 24, patch.height + 24).contains({x, y})) continue;
      ++seen;
      lost += !(std::abs(disparity.at<float>(y, x) - kSlanted.At(x, y)) < 0.5);
    }
  }
  EXPECT_LT(lost, seen / 100);
}

// Two dark areas: one with nothing but noise, which paths cross with disparities of their own, and one clipped to
// black.
TEST(MatchStereo, DarkAreasAreNotGuessed) {
  const Speckle speckle(kSize, 1);
  const cv::Rect dark(130, 80, 80, 70);
  for (const double grey : {3.0, 0.0}) {
    const auto light = [&](double x, double y) {
      const bool inside = x >= dark.x && x < dark.x + dark.width && y >= dark.y && y < dark.y + dark.height;
      return inside ? grey : speckle.At(x, y);
    };
    const cv::Mat left = Render(kSize, 2, 1, [&](int x, int y) { return light(x, y); });
    const cv::Mat right = Render(kSize, 2, 2, [&](int x, int y) { return 0.7 * light(kSlanted.LeftColumn(x, y), y); });
    const cv::Mat disparity = MatchStereo(left, right, kRange, {}).disparity_px;
    const cv::Rect inside(dark.x + 6, dark.y + 6, dark.width - 12, dark.height - 12);
    const int guessed = cv::countNonZero(disparity(inside) < 1e6);
    std::printf("dark at %.0f: %.2f %% of the pixels guessed\n", grey, 100.0 * guessed / inside.area());
    EXPECT_LT(guessed, 0.05 * inside.area())
        << grey;  // measured: see the line printed; 6 to 17 % without the last check
  }
}

TEST(MatchStereo, PixelsOutsideTheMaskAreInvalid) {
  const StereoPair pair = RenderPlane(kSize, kSlanted, 2, 1);
  cv::Mat mask(kSize, CV_8UC1, cv::Scalar(255));
  mask(cv::Rect(100, 50, 40, 40)).setTo(0);
  const StereoResult result = MatchStereo(pair.left, pair.right, kRange, {}, {mask, {}});
  EXPECT_EQ(cv::countNonZero(result.disparity_px(cv::Rect(100, 50, 40, 40)) < 1e6), 0);
  EXPECT_GT(cv::countNonZero(result.disparity_px < 1e6), 0.7 * (kSize.area() - 1600));
}

TEST(MatchStereo, EveryValidPixelHasADeviationAndNoOther) {
  const StereoPair pair = RenderPlane(kSize, kSlanted, 6, 1);
  for (const int radius : {0, 5}) {
    const StereoResult result = MatchStereo(pair.left, pair.right, kRange, {.refine_radius_px = radius});
    const cv::Mat valid = result.disparity_px<1e6, stated = result.deviation_px> 0;
    EXPECT_EQ(cv::countNonZero(valid != stated), 0) << "radius " << radius;
  }
}

TEST(MatchStereo, RefusesPicturesThatDoNotFit) {
  const cv::Mat eight(20, 30, CV_8UC1, cv::Scalar(1)), sixteen(20, 30, CV_16UC1, cv::Scalar(1)),
      other(20, 31, CV_8UC1, cv::Scalar(1)), colour(20, 30, CV_8UC3, cv::Scalar::all(1));
  EXPECT_THROW(static_cast<void>(MatchStereo(eight, other, {0, 8}, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(MatchStereo(eight, sixteen, {0, 8}, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(MatchStereo(colour, colour, {0, 8}, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(MatchStereo({}, {}, {0, 8}, {})), std::invalid_argument);
}

TEST(MatchStereo, RefusesRangesThatCannotMatch) {
  const cv::Mat picture(20, 30, CV_8UC1, cv::Scalar(1));
  EXPECT_THROW(static_cast<void>(MatchStereo(picture, picture, {0, 0}, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(MatchStereo(picture, picture, {30, 8}, {})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(MatchStereo(picture, picture, {-40, 10}, {})), std::invalid_argument);
  EXPECT_NO_THROW(static_cast<void>(MatchStereo(picture, picture, {29, 8}, {})));
}

TEST(MatchStereo, ServesPicturesOfOnePixel) {
  const cv::Mat dot(1, 1, CV_8UC1, cv::Scalar(7));
  EXPECT_FALSE(std::isfinite(MatchStereo(dot, dot, {0, 1}, {}).disparity_px.at<float>(0, 0)));
}

}  // namespace
}  // namespace granary
