#include "drivers/pixel_formats.h"

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <turbojpeg.h>
#include <opencv2/core.hpp>

namespace granary {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::array kRawLayouts{PixelLayout::kMono8,        PixelLayout::kMono10, PixelLayout::kMono12,
                                 PixelLayout::kMono14,       PixelLayout::kMono16, PixelLayout::kMono10p,
                                 PixelLayout::kMono12p,      PixelLayout::kMipi10, PixelLayout::kMono10Packed,
                                 PixelLayout::kMono12Packed, PixelLayout::kYuyv};

cv::Mat Grey(const Bytes& bytes, PixelLayout layout, cv::Size size, std::size_t row_bytes = 0) {
  return ToGrey(std::as_bytes(std::span(bytes)), layout, size, row_bytes);
}

// One row as plain numbers.
std::vector<int> Row(const Bytes& bytes, PixelLayout layout, int width) {
  cv::Mat wide;
  Grey(bytes, layout, {width, 1}).convertTo(wide, CV_32S);
  return {wide.begin<int>(), wide.end<int>()};
}

std::string WordsOf(const std::function<void()>& call) {
  try {
    call();
    return "nothing was thrown";
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
}

// Sets bit `bit` of pixel x where the layout's definition puts it, one bit at a time: slow, and unlike the reader.
void PutBit(Bytes& bytes, std::size_t row_start, PixelLayout layout, int x, int bit, bool on) {
  std::size_t byte = 0;
  int at = 0;
  const auto column = static_cast<std::size_t>(x);
  const std::size_t odd = column % 2;
  switch (layout) {
    case PixelLayout::kMono8:
      byte = column, at = bit;
      break;
    case PixelLayout::kYuyv:
      byte = 2 * column, at = bit;
      break;
    case PixelLayout::kMono10p:
    case PixelLayout::kMono12p: {
      const std::size_t place = column * (layout == PixelLayout::kMono10p ? 10 : 12) + static_cast<std::size_t>(bit);
      byte = place / 8, at = static_cast<int>(place % 8);
      break;
    }
    case PixelLayout::kMono10Packed:
    case PixelLayout::kMono12Packed: {
      const int low = layout == PixelLayout::kMono10Packed ? 2 : 4;
      byte = column / 2 * 3 + (bit < low ? 1 : 2 * odd);
      at = bit < low ? bit + 4 * static_cast<int>(odd) : bit - low;
      break;
    }
    case PixelLayout::kMipi10:
      byte = column / 4 * 5 + (bit < 2 ? 4 : column % 4);
      at = bit < 2 ? bit + 2 * static_cast<int>(column % 4) : bit - 2;
      break;
    default:
      byte = 2 * column + static_cast<std::size_t>(bit / 8), at = bit % 8;
  }
  if (on) bytes.at(row_start + byte) |= static_cast<std::uint8_t>(1U << at);
}

struct Packed {
  cv::Mat truth;  // CV_32S
  Bytes bytes;    // exactly as many as needed
};

Packed PackRandom(PixelLayout layout, cv::Size size, std::size_t row_bytes, std::mt19937& random) {
  Packed packed{cv::Mat(size, CV_32S),
                Bytes(row_bytes * static_cast<std::size_t>(size.height - 1) + RowBytesOf(layout, size.width))};
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const int value = static_cast<int>(random() & ((1U << BitDepthOf(layout)) - 1));
      packed.truth.at<int>(y, x) = value;
      for (int bit = 0; bit < BitDepthOf(layout); ++bit) {
        PutBit(packed.bytes, static_cast<std::size_t>(y) * row_bytes, layout, x, bit, (value >> bit & 1) != 0);
      }
    }
  }
  return packed;
}

bool Equal(const cv::Mat& grey, const cv::Mat& truth) {
  cv::Mat wide;
  grey.convertTo(wide, CV_32S);
  return grey.size() == truth.size() && cv::norm(wide, truth, cv::NORM_INF) == 0;
}

// A smooth picture as baseline JPEG.
Bytes Jpeg(cv::Size size, int subsampling = TJSAMP_422) {
  cv::Mat bgr(size, CV_8UC3);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const int grey = 2 * x + y;
      bgr.at<cv::Vec3b>(y, x) = cv::Vec3b::all(static_cast<std::uint8_t>(grey));
    }
  }
  const std::unique_ptr<void, int (*)(tjhandle)> coder(tjInitCompress(), tjDestroy);
  unsigned char* data = nullptr;
  unsigned long count = 0;
  EXPECT_EQ(tjCompress2(coder.get(), bgr.data, size.width, 0, size.height, TJPF_BGR, &data, &count, subsampling, 95, 0),
            0);
  Bytes bytes(data, data + count);
  tjFree(data);
  return bytes;
}

// Without its DHT segments, as USB cameras send their frames.
Bytes WithoutHuffmanTables(const Bytes& jpeg) {
  Bytes out(jpeg.begin(), jpeg.begin() + 2);
  for (std::size_t at = 2; at + 4 <= jpeg.size();) {
    const std::size_t length = 2U + (static_cast<std::size_t>(jpeg[at + 2]) << 8 | jpeg[at + 3]);
    const bool scan = jpeg[at + 1] == 0xDA;
    const auto end = scan ? jpeg.end() : jpeg.begin() + static_cast<std::ptrdiff_t>(at + length);
    if (jpeg[at + 1] != 0xC4) out.insert(out.end(), jpeg.begin() + static_cast<std::ptrdiff_t>(at), end);
    if (scan) break;
    at += length;
  }
  return out;
}

TEST(ToGrey, ReadsMono8) { EXPECT_THAT(Row({0, 1, 255}, PixelLayout::kMono8, 3), testing::ElementsAre(0, 1, 255)); }

TEST(ToGrey, ReadsWordsLowByteFirst) {
  EXPECT_THAT(Row({0x01, 0x03, 0xFF, 0x03}, PixelLayout::kMono10, 2), testing::ElementsAre(0x301, 0x3FF));
  EXPECT_THAT(Row({0x34, 0x02, 0xFF, 0x0F}, PixelLayout::kMono12, 2), testing::ElementsAre(0x234, 0xFFF));
  EXPECT_THAT(Row({0x34, 0x32}, PixelLayout::kMono14, 1), testing::ElementsAre(0x3234));
  EXPECT_THAT(Row({0x34, 0xF2}, PixelLayout::kMono16, 1), testing::ElementsAre(0xF234));
}

TEST(ToGrey, ReadsMono10pLeastSignificantBitFirst) {
  // 0x3FF, 0, 0x155, 0x201: ten bits each, from the low end.
  EXPECT_THAT(Row({0xFF, 0x03, 0x50, 0x55, 0x80}, PixelLayout::kMono10p, 4),
              testing::ElementsAre(0x3FF, 0x000, 0x155, 0x201));
}

TEST(ToGrey, ReadsMono12pLeastSignificantBitFirst) {
  EXPECT_THAT(Row({0xBC, 0x3A, 0x12}, PixelLayout::kMono12p, 2), testing::ElementsAre(0xABC, 0x123));
}

TEST(ToGrey, ReadsMono10PackedWithTheLowBitsBetween) {
  // High eight bits of the first, low two of both in bits 0-1 and 4-5, high eight of the second.
  EXPECT_THAT(Row({0xFF, 0x21, 0x80}, PixelLayout::kMono10Packed, 2), testing::ElementsAre(0x3FD, 0x202));
}

TEST(ToGrey, ReadsMono12PackedWithTheLowBitsBetween) {
  EXPECT_THAT(Row({0xAB, 0x3C, 0x12}, PixelLayout::kMono12Packed, 2), testing::ElementsAre(0xABC, 0x123));
}

TEST(ToGrey, ReadsMipi10WithTheLowBitsLast) {
  EXPECT_THAT(Row({0xFF, 0x00, 0x80, 0x01, 0b11100100}, PixelLayout::kMipi10, 4),
              testing::ElementsAre(0x3FC, 0x001, 0x202, 0x007));
}

TEST(ToGrey, TakesTheLumaOfYuyvAsItIs) {
  EXPECT_THAT(Row({16, 128, 235, 128, 0, 1, 255, 2}, PixelLayout::kYuyv, 4), testing::ElementsAre(16, 235, 0, 255));
}

TEST(ToGrey, ReadsOddWidthsFromTheirLastWholeGroup) {
  EXPECT_THAT(Row({0xAB, 0x0C}, PixelLayout::kMono12Packed, 1), testing::ElementsAre(0xABC));
  EXPECT_THAT(Row({0xBC, 0x0A}, PixelLayout::kMono12p, 1), testing::ElementsAre(0xABC));
  EXPECT_THAT(Row({0xFF, 0, 0, 0, 0b01}, PixelLayout::kMipi10, 1), testing::ElementsAre(0x3FD));
  EXPECT_THAT(Row({7, 128, 0, 128}, PixelLayout::kYuyv, 1), testing::ElementsAre(7));
}

TEST(ToGrey, GivesBackWhatWasPackedInEveryLayoutSizeAndPadding) {
  std::mt19937 random(1);
  for (const PixelLayout layout : kRawLayouts) {
    for (int trial = 0; trial < 60; ++trial) {
      const cv::Size size(1 + static_cast<int>(random() % 37), 1 + static_cast<int>(random() % 9));
      const std::size_t row_bytes = RowBytesOf(layout, size.width) + random() % 3 * 5;
      const Packed packed = PackRandom(layout, size, row_bytes, random);
      const cv::Mat grey = Grey(packed.bytes, layout, size, row_bytes);
      EXPECT_TRUE(Equal(grey, packed.truth)) << "layout " << static_cast<int>(layout) << ", " << size;
      EXPECT_EQ(grey.type(), BitDepthOf(layout) == 8 ? CV_8UC1 : CV_16UC1);
    }
  }
}

TEST(ToGrey, RefusesBuffersOneByteShortInEveryLayout) {
  std::mt19937 random(2);
  for (const PixelLayout layout : kRawLayouts) {
    for (int trial = 0; trial < 60; ++trial) {
      const cv::Size size(1 + static_cast<int>(random() % 37), 1 + static_cast<int>(random() % 9));
      const std::size_t row_bytes = RowBytesOf(layout, size.width) + random() % 3 * 5;
      Packed packed = PackRandom(layout, size, row_bytes, random);
      packed.bytes.pop_back();
      packed.bytes.shrink_to_fit();
      EXPECT_THROW((void)Grey(packed.bytes, layout, size, row_bytes), std::invalid_argument);
    }
  }
}

// Under the address sanitizer this is a search for reads past the end.
TEST(ToGrey, EitherReadsOrRefusesRandomBytes) {
  std::mt19937 random(3);
  int read = 0, refused = 0;
  for (int trial = 0; trial < 5000; ++trial) {
    const PixelLayout layout = kRawLayouts.at(random() % kRawLayouts.size());
    Bytes bytes(random() % 400);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
    bytes.shrink_to_fit();
    const cv::Size size(static_cast<int>(random() % 24) - 1, static_cast<int>(random() % 12) - 1);
    try {
      EXPECT_EQ(Grey(bytes, layout, size, random() % 60).size(), size);
      ++read;
    } catch (const std::invalid_argument&) {
      ++refused;
    }
  }
  EXPECT_GT(read, 100);
  EXPECT_GT(refused, 100);
}

TEST(ToGrey, PassesOverBytesBehindThePicture) {
  EXPECT_THAT(Row({5, 6, 99, 99}, PixelLayout::kMono8, 2), testing::ElementsAre(5, 6));
}

TEST(ToGrey, OwnsItsPixels) {
  Bytes bytes{1, 2, 3, 4};
  const cv::Mat grey = Grey(bytes, PixelLayout::kMono8, {2, 2});
  bytes.assign(4, 0);
  EXPECT_EQ(grey.at<std::uint8_t>(1, 1), 4);
}

TEST(ToGrey, RefusesValuesBeyondTheBits) {
  EXPECT_THAT(WordsOf([] { (void)Row({0, 0x04}, PixelLayout::kMono10, 1); }), testing::HasSubstr("more than 10 bits"));
  EXPECT_THROW((void)Row({0, 0x10}, PixelLayout::kMono12, 1), std::invalid_argument);
  EXPECT_THROW((void)Row({0, 0x40}, PixelLayout::kMono14, 1), std::invalid_argument);
}

TEST(ToGrey, RefusesMono12PackedDeclaredAsMono10Packed) {
  EXPECT_THROW((void)Row({0xAB, 0x0C, 0x12}, PixelLayout::kMono10Packed, 2), std::invalid_argument);
  EXPECT_THROW((void)Row({0xAB, 0x40, 0x12}, PixelLayout::kMono10Packed, 2), std::invalid_argument);
}

TEST(ToGrey, RefusesRowsShorterThanTheirPixels) {
  EXPECT_THAT(WordsOf([] {
                (void)Grey(Bytes(100), PixelLayout::kMono16, {4, 4}, 7);
              }),
              testing::AllOf(testing::HasSubstr("rows of 7 bytes"), testing::HasSubstr("need 8")));
}

TEST(ToGrey, RefusesPicturesWithoutPixels) {
  EXPECT_THROW((void)Grey({}, PixelLayout::kMono8, {0, 4}), std::invalid_argument);
  EXPECT_THROW((void)Grey({}, PixelLayout::kJpeg, {4, -1}), std::invalid_argument);
}

TEST(ToGrey, SaysHowManyBytesAreMissing) {
  EXPECT_THAT(WordsOf([] {
                (void)Grey(Bytes(9), PixelLayout::kMono12, {3, 2});
              }),
              testing::AllOf(testing::HasSubstr("Mono12"), testing::HasSubstr("9 bytes"), testing::HasSubstr("12")));
}

TEST(ToGrey, ReadsJpegsAsGrey) {
  const cv::Mat grey = Grey(Jpeg({40, 24}), PixelLayout::kJpeg, {40, 24});
  ASSERT_EQ(grey.type(), CV_8UC1);
  EXPECT_NEAR(grey.at<std::uint8_t>(10, 20), 50, 3);  // 2 x + y, coded at quality 95
}

TEST(ToGrey, ReadsJpegsThatAreGreyThemselves) {
  const cv::Mat grey = Grey(Jpeg({40, 24}, TJSAMP_GRAY), PixelLayout::kJpeg, {40, 24});
  EXPECT_NEAR(grey.at<std::uint8_t>(10, 20), 50, 3);
}

TEST(ToGrey, ReadsJpegsWithoutHuffmanTables) {
  const Bytes whole = Jpeg({40, 24});
  const Bytes bare = WithoutHuffmanTables(whole);
  ASSERT_LT(bare.size() + 100, whole.size());
  const cv::Mat a = Grey(whole, PixelLayout::kJpeg, {40, 24}), b = Grey(bare, PixelLayout::kJpeg, {40, 24});
  EXPECT_EQ(cv::norm(a, b, cv::NORM_INF), 0);
}

TEST(ToGrey, RefusesJpegsCutAnywhere) {
  const Bytes whole = Jpeg({40, 24});
  for (std::size_t count = 0; count < whole.size(); ++count) {
    Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(count));
    EXPECT_THROW((void)Grey(cut, PixelLayout::kJpeg, {40, 24}), std::invalid_argument) << count << " bytes";
    // Drivers that keep the buffer's old end make it harder to see.
    cut.resize(whole.size() + 64, 0);
    EXPECT_THROW((void)Grey(cut, PixelLayout::kJpeg, {40, 24}), std::invalid_argument) << count << " bytes";
  }
}

TEST(ToGrey, ReadsJpegsWithRubbishBehindThem) {
  Bytes bytes = Jpeg({40, 24});
  bytes.resize(bytes.size() + 100, 0xA5);
  EXPECT_EQ(Grey(bytes, PixelLayout::kJpeg, {40, 24}).cols, 40);
}

TEST(ToGrey, RefusesJpegsOfAnotherSize) {
  const Bytes bytes = Jpeg({40, 24});
  EXPECT_THAT(WordsOf([&] {
                (void)Grey(bytes, PixelLayout::kJpeg, {48, 24});
              }),
              testing::AllOf(testing::HasSubstr("40x24"), testing::HasSubstr("48x24")));
}

TEST(ToGrey, EitherReadsOrRefusesSpoiltJpegs) {
  std::mt19937 random(4);
  const Bytes whole = Jpeg({40, 24});
  int refused = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    Bytes bytes = whole;
    for (unsigned i = 0; i < 1 + random() % 4; ++i) {
      bytes.at(random() % bytes.size()) = static_cast<std::uint8_t>(random());
    }
    try {
      EXPECT_EQ(Grey(bytes, PixelLayout::kJpeg, {40, 24}).size(), cv::Size(40, 24));
    } catch (const std::invalid_argument&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 100);
}

TEST(LayoutOf, KnowsTheGenicamNames) {
  EXPECT_EQ(LayoutOfGenicam("Mono12p"), PixelLayout::kMono12p);
  EXPECT_EQ(LayoutOfGenicam("Mono10Packed"), PixelLayout::kMono10Packed);
  EXPECT_EQ(LayoutOfGenicam("YUV422_8"), PixelLayout::kYuyv);
  EXPECT_EQ(LayoutOfGenicam("BayerRG8"), std::nullopt);
  EXPECT_EQ(LayoutOfGenicam(""), std::nullopt);
}

TEST(LayoutOf, KnowsTheFourCharactersWithAndWithoutSpaces) {
  EXPECT_EQ(LayoutOfV4l2("Y10 "), PixelLayout::kMono10);
  EXPECT_EQ(LayoutOfV4l2("Y10"), PixelLayout::kMono10);
  EXPECT_EQ(LayoutOfV4l2("Y10P"), PixelLayout::kMipi10);
  EXPECT_EQ(LayoutOfV4l2("MJPG"), PixelLayout::kJpeg);
  EXPECT_EQ(LayoutOfV4l2("NV12"), std::nullopt);
  EXPECT_EQ(LayoutOfV4l2(""), std::nullopt);
}

TEST(RowBytesOf, RoundsUpToWholeGroups) {
  EXPECT_EQ(RowBytesOf(PixelLayout::kMono10p, 5), 7u);
  EXPECT_EQ(RowBytesOf(PixelLayout::kMono12Packed, 3), 5u);
  EXPECT_EQ(RowBytesOf(PixelLayout::kMipi10, 5), 10u);
  EXPECT_EQ(RowBytesOf(PixelLayout::kYuyv, 3), 8u);
}

}  // namespace
}  // namespace granary
