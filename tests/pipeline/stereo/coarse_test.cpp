// Coarse to fine against the search of everything, on speckle pairs of known disparity.
#include "pipeline/stereo/coarse.h"

#include <cmath>
#include <cstdio>
#include <optional>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "pipeline/stereo/match.h"
#include "tests/pipeline/speckle.h"

namespace granary {
namespace {

const cv::Size kSize{400, 200};
constexpr DisparityRange kRange{4, 250};
constexpr DisparityPlane kPlane{20.3, 0.06, 0.05};  // 20 to 54 px

GreyPair Grey(const StereoPair& pair) {
  GreyPair out;
  pair.left.convertTo(out.left, CV_32FC1);
  pair.right.convertTo(out.right, CV_32FC1);
  return out;
}

/// A box whose top has 24 px more disparity than the ground, from column kEdge on.
constexpr int kEdge = 200;
constexpr double kGround = 20.4, kTop = 44.7;
StereoPair Step() {
  const Speckle ground({480, 200}, 1), top({480, 200}, 2);
  return {Render(kSize, 2, 3, [&](int x, int y) { return x >= kEdge ? top.At(x, y) : ground.At(x, y); }),
          Render(kSize, 2, 4,
                 [&](int x, int y) { return x + kTop >= kEdge ? top.At(x + kTop, y) : ground.At(x + kGround, y); })};
}

TEST(ProposeTiles, WindowsHoldTheSurface) {
  const auto tiles = ProposeTiles(Grey(RenderPlane(kSize, kPlane, 2, 1)), kRange, {});
  ASSERT_TRUE(tiles.has_value());
  EXPECT_EQ(tiles->count, 64);
  for (int y = 0; y < kSize.height; ++y) {
    for (int x = 0; x < kSize.width; ++x) {
      const int first = tiles->first.at<int>(y / 32, x / 32) + kRange.min_px;
      ASSERT_GT(kPlane.At(x, y), first) << x << ", " << y;
      ASSERT_LT(kPlane.At(x, y), first + tiles->count - 1) << x << ", " << y;
    }
  }
}

TEST(ProposeTiles, WindowsAtAStepHoldBothSides) {
  const auto tiles = ProposeTiles(Grey(Step()), kRange, {});
  ASSERT_TRUE(tiles.has_value());
  for (int v = 0; v < tiles->first.rows; ++v) {
    const int first = tiles->first.at<int>(v, kEdge / 32) + kRange.min_px;
    EXPECT_LT(first, kGround);
    EXPECT_GT(first + tiles->count, kTop);
  }
}

TEST(ProposeTiles, DeclinesWhereItWouldNotPay) {
  EXPECT_FALSE(ProposeTiles(Grey(RenderPlane(kSize, kPlane, 2, 1)), {4, 80}, {}).has_value());
}

TEST(ProposeTiles, DeclinesPicturesThatMatchNowhere) {
  const cv::Mat blank(kSize, CV_8UC1, cv::Scalar(70));
  EXPECT_FALSE(ProposeTiles(Grey({blank, blank}), kRange, {}).has_value());
}

TEST(ProposeTiles, ServesRangesBelowZero) {
  const DisparityPlane plane{-60.2, 0.05, 0.02};
  const auto tiles = ProposeTiles(Grey(RenderPlane(kSize, plane, 2, 1)), {-130, 200}, {});
  ASSERT_TRUE(tiles.has_value());
  for (int u = 0; u < tiles->first.cols; ++u) {
    const int first = tiles->first.at<int>(2, u) - 130;
    EXPECT_LT(first, plane.At(u * 32 + 16, 80));
    EXPECT_GT(first + tiles->count, plane.At(u * 32 + 16, 80));
  }
}

TEST(MatchStereo, CoarseToFineIsTheFullSearch) {
  const StereoPair pair = RenderPlane(kSize, kPlane, 2, 1);
  StereoOptions coarse;
  coarse.coarse_to_fine = true;
  const cv::Mat full = MatchStereo(pair.left, pair.right, kRange, {}).disparity_px;
  const cv::Mat fine = MatchStereo(pair.left, pair.right, kRange, coarse).disparity_px;
  const double valid = cv::countNonZero(full < 1e6);
  const double same = cv::countNonZero((cv::abs(full - fine) < 0.01) & (full < 1e6));
  std::printf("the same to 0.01 px: %.3f %%, valid %.0f and %d\n", 100 * same / valid, valid,
              cv::countNonZero(fine < 1e6));
  EXPECT_GT(same, 0.995 * valid);  // measured: see the line printed; paths differ only where a window ends
  EXPECT_GT(cv::countNonZero(fine < 1e6), 0.995 * valid);
}

TEST(MatchStereo, CoarseToFineFindsBothSidesOfAStep) {
  const StereoPair pair = Step();
  StereoOptions coarse;
  coarse.coarse_to_fine = true;
  const cv::Mat disparity = MatchStereo(pair.left, pair.right, kRange, coarse).disparity_px;
  int right = 0, seen = 0;
  for (int y = 16; y < 184; ++y) {
    for (int x = 80; x < 384; ++x) {
      if (std::abs(x - kEdge) < 40) continue;  // what one camera alone sees, and the windows that straddle the edge
      ++seen;
      right += std::abs(disparity.at<float>(y, x) - (x < kEdge ? kGround : kTop)) < 0.2;
    }
  }
  EXPECT_GT(right, 0.99 * seen);
}

}  // namespace
}  // namespace granary
