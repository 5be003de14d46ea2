// TIFF: every compression as OpenCV (libtiff) writes it, and files laid out by hand for what it does not write.
#include "pipeline/tiff_file.h"

#include <zlib.h>

#include <cstdint>
#include <map>
#include <tuple>
#include <vector>

#include <gmock/gmock.h>
#include <opencv2/imgcodecs.hpp>

#include "tests/pipeline/test_pictures.h"

namespace granary {
namespace {

using testing::HasSubstr;

class EveryTiffPacking : public testing::TestWithParam<std::tuple<int, int, int, int>> {};
INSTANTIATE_TEST_SUITE_P(TypeCompressionPredictorRows, EveryTiffPacking,
                         testing::Combine(testing::Values(CV_8UC1, CV_16UC1),
                                          testing::Values(1, 5, 8, 32773),  // none, LZW, Deflate, PackBits
                                          testing::Values(1, 2),            // none, horizontal
                                          testing::Values(1, 10, 97)));     // rows a strip: one, some left, all

TEST_P(EveryTiffPacking, WhatOpencvWritesIsRead) {
  const auto [type, compression, predictor, rows] = GetParam();
  const cv::Mat image = TestPicture(type);
  std::vector<std::uint8_t> bytes;
  // 259, 317 and 278 are the TIFF tags of these settings; OpenCV takes the tags themselves.
  ASSERT_TRUE(cv::imencode(".tif", image, bytes, {259, compression, 317, predictor, 278, rows}));
  EXPECT_TRUE(SamePicture(DecodeTiff("f.tif", {reinterpret_cast<char*>(bytes.data()), bytes.size()}), image));
}

TEST(DecodeTiff, LzwTablesThatFillUpManyTimesAreRead) {
  const cv::Mat image = TestPicture(CV_16UC1, 1280, 1024);
  std::vector<std::uint8_t> bytes;
  ASSERT_TRUE(cv::imencode(".tif", image, bytes, {259, 5, 278, 1024}));
  EXPECT_TRUE(SamePicture(DecodeTiff("f.tif", {reinterpret_cast<char*>(bytes.data()), bytes.size()}), image));
}

using Tags = std::map<int, std::uint32_t>;

struct Variant {
  bool big_endian = false, big_tiff = false;
};
/// Header, directory of 32-bit numbers, one strip of `pixels`.
std::string Tiff(Tags tags, const std::string& pixels, Variant variant = {}) {
  const auto number = [&](std::uint64_t value, int size) {
    std::string bytes;
    for (int i = 0; i < size; ++i) bytes += static_cast<char>(value >> 8 * (variant.big_endian ? size - 1 - i : i));
    return bytes;
  };
  const int wide = variant.big_tiff ? 8 : 4;  // bytes of an offset
  tags.emplace(279, pixels.size());
  const std::size_t entries = tags.size() + 1;
  const std::string header = variant.big_tiff
                                 ? number(43, 2) + number(8, 2) + number(0, 2) + number(16, 8) + number(entries, 8)
                                 : number(42, 2) + number(8, 4) + number(entries, 2);
  tags.emplace(273, 2 + header.size() + entries * (4 + 2 * wide) + wide);
  std::string bytes = (variant.big_endian ? "MM" : "II") + header;
  for (const auto& [tag, value] : tags) {
    bytes += number(tag, 2) + number(4, 2) + number(1, wide) + number(value, 4) + std::string(wide - 4, '\0');
  }
  return bytes + number(0, wide) + pixels;
}
/// Two by one pixel of 8 bits, as is.
Tags Small(const Tags& changes = {}) {
  Tags tags{{256, 2}, {257, 1}, {258, 8}, {259, 1}, {262, 1}};
  for (const auto& [tag, value] : changes) tags[tag] = value;
  return tags;
}
std::string Fault(const Tags& changes, const std::string& pixels = "abcd") {
  return FaultOf([&] { static_cast<void>(DecodeTiff("f.tif", Tiff(Small(changes), pixels))); });
}

TEST(DecodeTiff, BigEndianPixelsAreTurned) {
  const std::string pixels("\x12\x34\x00\x01", 4);
  EXPECT_TRUE(SamePicture(DecodeTiff("f.tif", Tiff(Small({{258, 16}}), pixels, {.big_endian = true})),
                          (cv::Mat_<std::uint16_t>(1, 2) << 0x1234, 1)));
  EXPECT_TRUE(SamePicture(DecodeTiff("f.tif", Tiff(Small({{258, 16}}), pixels)),
                          (cv::Mat_<std::uint16_t>(1, 2) << 0x3412, 0x100)));
}
TEST(DecodeTiff, BigEndianDifferencesAreTurnedBeforeTheyAreSummed) {
  const std::string differences("\x00\xff\x00\x02", 4);
  std::string packed(::compressBound(differences.size()), '\0');
  uLongf size = packed.size();
  ::compress(reinterpret_cast<Bytef*>(packed.data()), &size, reinterpret_cast<const Bytef*>(differences.data()),
             differences.size());
  // 32946 is Deflate's number of before 2002.
  const Tags tags = Small({{258, 16}, {259, 32946}, {317, 2}});
  EXPECT_TRUE(SamePicture(DecodeTiff("f.tif", Tiff(tags, packed.substr(0, size), {.big_endian = true})),
                          (cv::Mat_<std::uint16_t>(1, 2) << 255, 257)));
}
TEST(DecodeTiff, BigTiffIsRead) {
  for (const bool big_endian : {false, true}) {
    EXPECT_TRUE(SamePicture(DecodeTiff("f.tif", Tiff(Small(), "\x05\x06", {big_endian, true})),
                            (cv::Mat_<std::uint8_t>(1, 2) << 5, 6)));
  }
}
TEST(DecodeTiff, ColourAndOddPixelsAreNamed) {
  EXPECT_THAT(Fault({{277, 3}, {262, 2}}), HasSubstr("colour picture (3 channels)"));
  EXPECT_THAT(Fault({{262, 3}}), HasSubstr("palette"));
  EXPECT_THAT(Fault({{262, 0}}), HasSubstr("MinIsBlack is wanted"));
  EXPECT_THAT(Fault({{262, 32803}}), HasSubstr("photometric interpretation 32803"));
  EXPECT_THAT(Fault({{258, 12}}), HasSubstr("no unsigned 8- or 16-bit numbers"));
  EXPECT_THAT(Fault({{339, 2}}), HasSubstr("no unsigned 8- or 16-bit numbers"));
}
TEST(DecodeTiff, OtherWaysOfStoringAreNamedWithWhatIsRead) {
  EXPECT_THAT(Fault({{259, 7}}), HasSubstr("compression 7; 1 (none), 5 (LZW), 8 (Deflate) and 32773 (PackBits)"));
  EXPECT_THAT(Fault({{317, 3}, {259, 5}}), HasSubstr("predictor 3"));
  EXPECT_THAT(Fault({{317, 2}}), HasSubstr("predictor 2"));
  EXPECT_THAT(Fault({{266, 2}}), HasSubstr("fill order 2"));
  EXPECT_THAT(Fault({{274, 3}}), HasSubstr("orientation 3"));
  EXPECT_THAT(Fault({{322, 16}, {323, 16}, {324, 8}, {325, 4}}), HasSubstr("in tiles; strips are wanted"));
}
TEST(DecodeTiff, AbsurdSizesAreRefusedBeforeMemoryIsTaken) {
  EXPECT_THAT(Fault({{256, 0xFFFFFFFF}}), HasSubstr("4294967295x1 pixels; 1 to 16384"));
  EXPECT_THAT(Fault({{257, 0}}), HasSubstr("2x0 pixels"));
}
TEST(DecodeTiff, StripsThatDoNotFillThePictureAreDamage) {
  EXPECT_THAT(Fault({{257, 2}, {278, 1}}), HasSubstr("it has 1 strips, its header says 2"));
  EXPECT_THAT(Fault({{278, 0}}), HasSubstr("no rows"));
  for (const std::uint32_t compression : {1U, 5U, 8U, 32773U}) {
    EXPECT_THAT(Fault({{259, compression}}, "a"), HasSubstr("strip 1 of 1 does not unpack to its 2 bytes"))
        << compression;
  }
}
TEST(DecodeTiff, AMissingTagIsNamed) {
  Tags tags = Small();
  tags.erase(262);
  EXPECT_THAT(FaultOf([&] { static_cast<void>(DecodeTiff("f.tif", Tiff(tags, "ab"))); }),
              HasSubstr("tag 262 is missing"));
}
TEST(DecodeTiff, LzwOfTheOldBitOrderIsRefused) {
  EXPECT_THAT(Fault({{259, 5}}, std::string("\x00\x01\x02\x03", 4)), HasSubstr("does not unpack"));
}
TEST(DecodeTiff, PackBitsRunsLiteralsAndNoOperationsAreRead) {
  const std::string packed("\x80\xff\x07\x00\x09", 5);  // nothing, 7 twice, 9 once
  EXPECT_TRUE(SamePicture(DecodeTiff("f.tif", Tiff(Small({{256, 3}, {259, 32773}}), packed)),
                          (cv::Mat_<std::uint8_t>(1, 3) << 7, 7, 9)));
}
TEST(DecodeTiff, PackBitsThatReachBeyondTheStripAreDamage) {
  EXPECT_THAT(Fault({{259, 32773}}, "\xfe\x07"), HasSubstr("does not unpack"));
  EXPECT_THAT(Fault({{259, 32773}}, "\x01\x07"), HasSubstr("does not unpack"));
}

}  // namespace
}  // namespace granary
