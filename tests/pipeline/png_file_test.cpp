// PNG: compared with OpenCV's own codec, and damaged by hand.
#include "pipeline/png_file.h"

#include <zlib.h>

#include <cstdint>
#include <vector>

#include <gmock/gmock.h>
#include <opencv2/imgcodecs.hpp>

#include "tests/pipeline/test_pictures.h"

namespace granary {
namespace {

using testing::HasSubstr;

std::string Number(std::uint32_t value) {
  return {static_cast<char>(value >> 24), static_cast<char>(value >> 16), static_cast<char>(value >> 8),
          static_cast<char>(value)};
}
std::string Chunk(const std::string& type, const std::string& data) {
  const std::string body = type + data;
  return Number(static_cast<std::uint32_t>(data.size())) + body +
         Number(static_cast<std::uint32_t>(::crc32_z(0, reinterpret_cast<const Bytef*>(body.data()), body.size())));
}
std::string Header(std::uint32_t width, std::uint32_t height, int bits, int colour) {
  return Chunk("IHDR", Number(width) + Number(height) + static_cast<char>(bits) + static_cast<char>(colour) +
                           std::string(3, '\0'));
}
std::string Packed(const std::string& rows) {
  std::string packed(::compressBound(rows.size()), '\0');
  uLongf size = packed.size();
  ::compress(reinterpret_cast<Bytef*>(packed.data()), &size, reinterpret_cast<const Bytef*>(rows.data()), rows.size());
  packed.resize(size);
  return packed;
}
const std::string kSignature("\x89PNG\r\n\x1a\n", 8);
std::string Png(const std::string& chunks) { return kSignature + chunks + Chunk("IEND", ""); }
std::string Fault(const std::string& bytes) {
  return FaultOf([&] { static_cast<void>(DecodePng("f.png", bytes)); });
}

class EveryPngType : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Types, EveryPngType, testing::Values(CV_8UC1, CV_16UC1, CV_8UC3, CV_16UC3));

TEST_P(EveryPngType, WhatIsWrittenOpencvReads) {
  const cv::Mat image = TestPicture(GetParam());
  const std::string bytes = EncodePng("f.png", image);
  const cv::Mat back = cv::imdecode(std::vector<char>(bytes.begin(), bytes.end()), cv::IMREAD_UNCHANGED);
  EXPECT_TRUE(SamePicture(back, image));
}
TEST_P(EveryPngType, WhatOpencvWritesIsRead) {
  const cv::Mat image = TestPicture(GetParam());
  std::vector<std::uint8_t> bytes;
  cv::imencode(".png", image, bytes);
  EXPECT_TRUE(SamePicture(DecodePng("f.png", {reinterpret_cast<char*>(bytes.data()), bytes.size()}), image));
}

TEST(EncodePng, PartsOfAPictureAreWrittenByTheirOwnRows) {
  const cv::Mat part = TestPicture(CV_16UC1)(cv::Rect(10, 20, 33, 44));
  EXPECT_TRUE(SamePicture(DecodePng("f.png", EncodePng("f.png", part)), part));
}
TEST(DecodePng, GreyOfFewBitsBecomesEight) {
  const cv::Mat image = DecodePng("f.png", Png(Header(2, 1, 4, 0) + Chunk("IDAT", Packed(std::string("\0\x0f", 2)))));
  EXPECT_TRUE(SamePicture(image, (cv::Mat_<std::uint8_t>(1, 2) << 0, 255)));
}
TEST(DecodePng, APaletteIsLookedUp) {
  const cv::Mat image = DecodePng("f.png", Png(Header(1, 1, 8, 3) + Chunk("PLTE", std::string("\1\2\3\4\5\6", 6)) +
                                               Chunk("IDAT", Packed(std::string("\0\1", 2)))));
  ASSERT_EQ(image.type(), CV_8UC3);
  EXPECT_EQ(image.at<cv::Vec3b>(0, 0), cv::Vec3b(6, 5, 4));  // blue first
}
TEST(DecodePng, GreyWithAlphaHasFourChannels) {
  const cv::Mat image =
      DecodePng("f.png", Png(Header(1, 1, 8, 4) + Chunk("IDAT", Packed(std::string("\0\x40\x80", 3)))));
  ASSERT_EQ(image.type(), CV_8UC4);
  EXPECT_EQ(image.at<cv::Vec4b>(0, 0), cv::Vec4b(64, 64, 64, 128));
}
TEST(DecodePng, TooFewRowsAreDamageAndSaySo) {
  EXPECT_THAT(Fault(Png(Header(1, 9, 8, 0) + Chunk("IDAT", Packed(std::string(2, '\0'))))),
              HasSubstr("f.png: is damaged: "));
}
TEST(DecodePng, AWrongSumOverThePixelsIsDamage) {
  std::string packed = Packed(std::string(2, '\0'));
  packed.back() ^= 1;
  EXPECT_THAT(Fault(Png(Header(1, 1, 8, 0) + Chunk("IDAT", packed))), HasSubstr("f.png: is damaged: "));
}
TEST(DecodePng, AHeaderThatPngDoesNotKnowIsDamage) {
  EXPECT_THAT(Fault(Png(Header(1, 1, 7, 0) + Chunk("IDAT", ""))), HasSubstr("f.png: is damaged: "));
  EXPECT_THAT(Fault(Png(Chunk("IDAT", "") + Header(1, 1, 8, 0))), HasSubstr("header is not the first"));
  EXPECT_THAT(Fault(Png(Header(1, 1, 8, 0))), HasSubstr("without pixels"));
}
TEST(DecodePng, AbsurdSizesAreRefusedBeforeMemoryIsTaken) {
  EXPECT_THAT(Fault(Png(Header(16385, 1, 8, 0) + Chunk("IDAT", ""))), HasSubstr("16385x1 pixels; 1 to 16384"));
  EXPECT_THAT(Fault(Png(Header(0, 1, 8, 0) + Chunk("IDAT", ""))), HasSubstr("0x1 pixels"));
}

}  // namespace
}  // namespace granary
