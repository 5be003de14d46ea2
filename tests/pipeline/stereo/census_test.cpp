#include "pipeline/stereo/census.h"

#include <algorithm>
#include <cstdint>
#include <random>
#include <stdexcept>
#include <tuple>

#include <gtest/gtest.h>
#include <hwy/highway.h>
#include <hwy/targets.h>
#include <opencv2/core.hpp>

namespace granary {
namespace {

cv::Mat RandomPicture(cv::Size size, int levels, unsigned seed) {
  std::mt19937 random(seed);
  cv::Mat picture(size, CV_32FC1);
  for (auto it = picture.begin<float>(); it != picture.end<float>(); ++it) *it = static_cast<float>(random() % levels);
  return picture;
}

/// METHOD §3 word for word: ζ(I(p), I(q)) = I(p) <= I(q) ? 0 : 1, neighbours row by row, border values repeated.
std::uint64_t WordByDefinition(const cv::Mat& grey, int x, int y, int width, int height) {
  std::uint64_t word = 0;
  int bit = 0;
  for (int dy = -height / 2; dy <= height / 2; ++dy) {
    for (int dx = -width / 2; dx <= width / 2; ++dx) {
      if (dx == 0 && dy == 0) continue;
      const int qx = std::clamp(x + dx, 0, grey.cols - 1), qy = std::clamp(y + dy, 0, grey.rows - 1);
      const bool one = !(grey.at<float>(y, x) <= grey.at<float>(qy, qx));
      word |= static_cast<std::uint64_t>(one) << bit++;
    }
  }
  return word;
}

CensusImage Transform(const cv::Mat& grey, int width, int height) {
  CensusImage census;
  CensusTransform(grey, width, height, census);
  return census;
}

void ExpectDefinition(const cv::Mat& grey, int width, int height) {
  const CensusImage census = Transform(grey, width, height);
  ASSERT_EQ(census.width, grey.cols);
  ASSERT_EQ(census.height, grey.rows);
  for (int y = 0; y < grey.rows; ++y) {
    for (int x = 0; x < grey.cols; ++x) {
      ASSERT_EQ(census.Word(y, x), WordByDefinition(grey, x, y, width, height)) << "pixel " << x << ", " << y;
    }
  }
}

class CensusWindow : public testing::TestWithParam<std::tuple<int, int>> {};

TEST_P(CensusWindow, BitsFollowTheDefinitionUpToTheBorder) {
  const auto [width, height] = GetParam();
  ExpectDefinition(RandomPicture({37, 23}, 256, 1), width, height);
}
INSTANTIATE_TEST_SUITE_P(Sizes, CensusWindow,
                         testing::Values(std::tuple{3, 3}, std::tuple{5, 5}, std::tuple{9, 7}, std::tuple{7, 9},
                                         std::tuple{3, 7}));

TEST(CensusTransform, EqualNeighboursGiveZero) {
  const CensusImage census = Transform(cv::Mat(8, 9, CV_32FC1, cv::Scalar(77)), 9, 7);
  for (int y = 0; y < 8; ++y) {
    for (int x = 0; x < 9; ++x) EXPECT_EQ(census.Word(y, x), 0u);
  }
}

TEST(CensusTransform, TellsNeighbouringValuesOf16BitPicturesApart) {
  // 65534 against 65535: differences of one level at the top of the range
  ExpectDefinition(RandomPicture({21, 17}, 2, 2) + 65534, 9, 7);
}

TEST(CensusTransform, ServesPicturesSmallerThanTheWindow) {
  ExpectDefinition(RandomPicture({1, 1}, 256, 3), 9, 7);
  ExpectDefinition(RandomPicture({40, 1}, 256, 4), 9, 7);
  ExpectDefinition(RandomPicture({2, 30}, 256, 5), 9, 7);
}

TEST(CensusTransform, TheBrightestPixelSetsEveryBit) {
  cv::Mat grey = cv::Mat::zeros(9, 9, CV_32FC1);
  grey.at<float>(4, 4) = 1;
  EXPECT_EQ(Transform(grey, 9, 7).Word(4, 4), (std::uint64_t{1} << CensusBits(9, 7)) - 1);
}

TEST(CensusTransform, RefusesWindowsThatDoNotFitTheWord) {
  const cv::Mat grey = RandomPicture({20, 20}, 256, 6);
  EXPECT_THROW(static_cast<void>(Transform(grey, 8, 7)), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(Transform(grey, 9, 6)), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(Transform(grey, 9, 9)), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(Transform(grey, -3, 3)), std::invalid_argument);
}

TEST(CensusTransform, EveryInstructionSetGivesTheSame) {
  const cv::Mat grey = RandomPicture({101, 40}, 256, 7);
  for (std::int64_t rest = hwy::SupportedTargets(); rest != 0; rest &= rest - 1) {
    hwy::SetSupportedTargetsForTest(rest & -rest);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    SCOPED_TRACE(hwy::TargetName(rest & -rest));
    ExpectDefinition(grey, 9, 7);
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

TEST(CensusTransform, RefusesOtherPixelTypes) {
  EXPECT_THROW(static_cast<void>(Transform(cv::Mat::zeros(9, 9, CV_8UC1), 9, 7)), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(Transform({}, 9, 7)), std::invalid_argument);
}

}  // namespace
}  // namespace granary
