#include "drivers/exposure.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <stdexcept>

namespace granary {
namespace {

Frame Picture(int bit_depth, std::initializer_list<int> greys) {
  Frame frame;
  frame.bit_depth = bit_depth;
  frame.image = cv::Mat(1, static_cast<int>(greys.size()), bit_depth == 8 ? CV_8UC1 : CV_16UC1);
  int x = 0;
  for (const int grey : greys) {
    if (bit_depth == 8)
      frame.image.at<std::uint8_t>(0, x++) = static_cast<std::uint8_t>(grey);
    else
      frame.image.at<std::uint16_t>(0, x++) = static_cast<std::uint16_t>(grey);
  }
  return frame;
}

int GreyAt(const Frame& frame, int x) { return frame.image.at<std::uint16_t>(0, x); }

TEST(SaturatedShare, CountsFullAndNearlyFullPixels) {
  EXPECT_DOUBLE_EQ(SaturatedShare(Picture(8, {255, 251, 240, 0})), 0.5);
}

TEST(SaturatedShare, KnowsTheBits) { EXPECT_DOUBLE_EQ(SaturatedShare(Picture(12, {4095, 1023, 255, 0})), 0.25); }

TEST(MergeBrackets, LeavesASinglePictureAsItIs) {
  const Frame frame = Picture(8, {1, 255});
  const Frame merged = MergeBrackets({frame});
  EXPECT_EQ(merged.bit_depth, 8);
  EXPECT_EQ(merged.image.type(), CV_8UC1);
}

TEST(MergeBrackets, TakesClippedPixelsFromTheShorterExposure) {
  const Frame merged = MergeBrackets({Picture(8, {200, 255}), Picture(8, {50, 100})});
  EXPECT_EQ(merged.bit_depth, 10);
  EXPECT_EQ(GreyAt(merged, 0), 200);
  EXPECT_EQ(GreyAt(merged, 1), 400);
}

TEST(MergeBrackets, GoesOnToTheNextShorterOne) {
  const Frame merged = MergeBrackets({Picture(8, {255}), Picture(8, {255}), Picture(8, {90})});
  EXPECT_EQ(merged.bit_depth, 12);
  EXPECT_EQ(GreyAt(merged, 0), 1440);
}

TEST(MergeBrackets, NeverMakesAClippedPixelDarkerThanItWas) {
  EXPECT_EQ(GreyAt(MergeBrackets({Picture(8, {255}), Picture(8, {10})}), 0), 255);
}

TEST(MergeBrackets, GivesUpLowBitsWhereSixteenAreTooFew) {
  const Frame merged = MergeBrackets({Picture(16, {40000, 65535}), Picture(16, {10000, 20000})});
  EXPECT_EQ(merged.bit_depth, 16);
  EXPECT_EQ(GreyAt(merged, 0), 10000);
  EXPECT_EQ(GreyAt(merged, 1), 20000);
}

TEST(MergeBrackets, RefusesPicturesThatAreNotAlike) {
  EXPECT_THROW((void)MergeBrackets({Picture(8, {1, 2}), Picture(8, {1})}), std::invalid_argument);
  EXPECT_THROW((void)MergeBrackets({Picture(10, {1}), Picture(12, {1})}), std::invalid_argument);
  EXPECT_THROW((void)MergeBrackets({}), std::invalid_argument);
}

}  // namespace
}  // namespace granary
