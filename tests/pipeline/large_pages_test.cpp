#include "pipeline/large_pages.h"

#include <cstdint>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

namespace granary {
namespace {

class LargePages : public testing::Test {
 protected:
  static void SetUpTestSuite() { UseLargePagesForPictures(); }
};

TEST_F(LargePages, LargeMemoryBeginsOnALargePage) {
  void* memory = AllocateLarge((std::size_t{2} << 20) + 1);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(memory) % (std::size_t{2} << 20), 0u);
  FreeLarge(memory);
}

TEST_F(LargePages, SmallMemoryIsAlignedForVectors) {
  for (const std::size_t bytes : {0, 1, 63, 64, 1000}) {
    void* memory = AllocateLarge(bytes);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(memory) % 64, 0u) << bytes;
    FreeLarge(memory);
  }
}

TEST_F(LargePages, PicturesKeepTheirPixels) {
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(33, 7), cv::Size(1280, 1024)}) {
    cv::Mat picture(size, CV_32FC1);
    std::iota(picture.begin<float>(), picture.end<float>(), 0.0f);
    const cv::Mat copy = picture.clone();
    cv::Mat shared = picture;
    picture.release();
    EXPECT_EQ(cv::norm(copy, shared, cv::NORM_INF), 0) << size;
    EXPECT_TRUE(shared.isContinuous()) << size;
  }
}

TEST_F(LargePages, PicturesAreAlignedForVectors) {
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(cv::Mat(10, 10, CV_8UC1).data) % 64, 0u);
}

TEST_F(LargePages, PartsOfAPictureOutliveIt) {
  cv::Mat part;
  {
    cv::Mat whole(2000, 2000, CV_16UC1, cv::Scalar(7));
    part = whole(cv::Rect(100, 200, 30, 40));
  }
  EXPECT_EQ(cv::sum(part)[0], 7 * 30 * 40);
}

TEST_F(LargePages, MemoryOfOthersIsNotFreed) {
  std::vector<std::uint8_t> pixels(12 * 10, 5);
  {
    const cv::Mat wrapped(10, 10, CV_8UC1, pixels.data(), 12);
    EXPECT_EQ(cv::sum(wrapped)[0], 500);
    EXPECT_EQ(cv::sum(wrapped.clone())[0], 500);
  }
  EXPECT_EQ(pixels[119], 5);
}

TEST_F(LargePages, ThreeDimensionsHaveTheirSteps) {
  const int sizes[] = {4, 5, 6};
  cv::Mat cube(3, sizes, CV_32FC2, cv::Scalar::all(2));
  EXPECT_EQ(cube.step[2], 8u);
  EXPECT_EQ(cube.step[1], 48u);
  EXPECT_EQ(cube.step[0], 240u);
  EXPECT_EQ(cube.total(), 120u);
}

TEST_F(LargePages, EmptyPicturesAreServed) {
  cv::Mat empty(0, 10, CV_8UC1);
  EXPECT_TRUE(empty.empty());
  EXPECT_TRUE(empty.clone().empty());
}

}  // namespace
}  // namespace granary
