#include "pipeline/stereo/usable.h"

#include <algorithm>
#include <cstdint>
#include <random>
#include <tuple>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

namespace granary {
namespace {

/// Noise of a few levels with flat patches, one of them at a corner.
cv::Mat Patched(cv::Size size, unsigned seed) {
  std::mt19937 random(seed);
  cv::Mat picture(size, CV_32FC1);
  for (auto it = picture.begin<float>(); it != picture.end<float>(); ++it) *it = static_cast<float>(random() % 4);
  for (const cv::Rect patch : {cv::Rect(0, 0, 13, 9), cv::Rect(30, 12, 20, 16), cv::Rect(22, 3, 8, 3)}) {
    picture(patch & cv::Rect({0, 0}, size)).setTo(2.0f);
  }
  return picture;
}

class TextureWindow : public testing::TestWithParam<std::tuple<int, int>> {};

TEST_P(TextureWindow, MarksExactlyTheWindowsOfOneValue) {
  const auto [width, height] = GetParam();
  const cv::Mat picture = Patched({61, 37}, 1);
  const cv::Mat flat = WithoutTexture(picture, width, height);
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      bool same = true;
      for (int v = std::max(0, y - height / 2); v <= std::min(picture.rows - 1, y + height / 2); ++v) {
        for (int u = std::max(0, x - width / 2); u <= std::min(picture.cols - 1, x + width / 2); ++u) {
          same = same && picture.at<float>(v, u) == picture.at<float>(y, x);
        }
      }
      ASSERT_EQ(!flat.empty() && flat.at<std::uint8_t>(y, x) != 0, same) << x << ", " << y;
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Sizes, TextureWindow,
                         testing::Values(std::tuple{9, 7}, std::tuple{3, 3}, std::tuple{5, 5}, std::tuple{3, 7}));

TEST(WithoutTexture, IsEmptyWhereEveryPixelDiffers) {
  cv::Mat picture(8, 9, CV_32FC1);
  for (int i = 0; i < 72; ++i) picture.at<float>(i / 9, i % 9) = static_cast<float>(i);
  EXPECT_TRUE(WithoutTexture(picture, 9, 7).empty());
}

TEST(WithoutTexture, ServesPicturesSmallerThanTheWindow) {
  EXPECT_EQ(WithoutTexture(cv::Mat(1, 1, CV_32FC1, cv::Scalar(3)), 9, 7).at<std::uint8_t>(0, 0), 255);
  EXPECT_EQ(cv::countNonZero(WithoutTexture(cv::Mat(1, 30, CV_32FC1, cv::Scalar(3)), 9, 7)), 30);
}

TEST(SaturatedAreas, APatchIsMarkedToItsCornersAndNoFurther) {
  cv::Mat full = cv::Mat::zeros(60, 80, CV_8UC1);
  const cv::Rect patch(20, 15, 30, 25);
  full(patch).setTo(255);
  const cv::Mat areas = SaturatedAreas(full);
  EXPECT_EQ(cv::countNonZero(areas(patch)), patch.area());
  EXPECT_EQ(cv::countNonZero(areas), patch.area());
}

TEST(SaturatedAreas, AHoleInAPatchBelongsToIt) {
  cv::Mat full(40, 40, CV_8UC1, cv::Scalar(255));
  full.at<std::uint8_t>(20, 20) = 0;
  EXPECT_EQ(SaturatedAreas(full).at<std::uint8_t>(20, 20), 255);
}

TEST(SaturatedAreas, FullCoresOfSingleDotsStayOut) {
  cv::Mat full = cv::Mat::zeros(60, 60, CV_8UC1);
  for (int y = 5; y < 60; y += 6) {
    for (int x = 5; x < 60; x += 6) full(cv::Rect(x, y, 2, 2) & cv::Rect(0, 0, 60, 60)).setTo(255);
  }
  EXPECT_EQ(cv::countNonZero(SaturatedAreas(full)), 0);
}

}  // namespace
}  // namespace granary
