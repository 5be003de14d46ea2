// Pictures and plain bytes: what was written is read back, and every fault is one FileError that names file and
// fault.
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "pipeline/file_bytes.h"
#include "pipeline/file_error.h"
#include "pipeline/frame_file.h"
#include "tests/pipeline/temporary_folder.h"
#include "tests/pipeline/test_pictures.h"

namespace granary {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

// ---------------------------------------------------------------- frames

cv::Mat Grey8(int width = 40, int height = 30) {
  cv::Mat image(height, width, CV_8UC1);
  cv::setRNGSeed(7);
  cv::randu(image, 0, 256);
  return image;
}
cv::Mat Grey16(int below, int width = 40, int height = 30) {
  cv::Mat image(height, width, CV_16UC1);
  cv::setRNGSeed(7);
  cv::randu(image, 0, below);
  image.at<std::uint16_t>(0, 0) = static_cast<std::uint16_t>(below - 1);
  return image;
}
std::string FrameFault(const fs::path& file) {
  return FaultOf([&] { static_cast<void>(LoadFrame(file)); });
}

/// What SaveFrame does not write, OpenCV writes.
void WritePicture(const fs::path& file, const cv::Mat& image) {
  if (file.extension() == ".png" || file.extension() == ".pgm") return SaveFrame(file, image);
  ASSERT_TRUE(cv::imwrite(file.string(), image));
}

class EveryPictureFormat : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Formats, EveryPictureFormat, testing::Values("a.png", "a.tif", "a.TIFF", "a.pgm"));

TEST_P(EveryPictureFormat, ReadsBackEightBits) {
  const TemporaryFolder folder;
  WritePicture(folder / GetParam(), Grey8());
  const Frame frame = LoadFrame(folder / GetParam());
  EXPECT_TRUE(SamePicture(frame.image, Grey8()));
  EXPECT_EQ(frame.bit_depth, 8);
  EXPECT_EQ(frame.source, (folder / GetParam()).string());
}
TEST_P(EveryPictureFormat, ReadsBackSixteenBits) {
  const TemporaryFolder folder;
  WritePicture(folder / GetParam(), Grey16(4096));
  EXPECT_TRUE(SamePicture(LoadFrame(folder / GetParam()).image, Grey16(4096)));
}
TEST_P(EveryPictureFormat, TruncatedAnywhereIsAnErrorAndSaysNothingOnStderr) {
  const TemporaryFolder folder;
  WritePicture(folder / GetParam(), Grey16(65536));
  const std::string whole = TemporaryFolder::Read(folder / GetParam());
  testing::internal::CaptureStderr();
  // 4 bytes are the least that can be told from "no picture at all"; after that any cut, whole - 1 included.
  for (std::size_t size = 4; size < whole.size(); size += size < 64 ? 1 : 97) {
    EXPECT_THAT(FrameFault(folder.Write(GetParam(), whole.substr(0, size))), HasSubstr("a.")) << size;
  }
  EXPECT_NE(FrameFault(folder.Write(GetParam(), whole.substr(0, whole.size() - 1))), "");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(LoadFrame, InfersTheBitDepthFromTheBrightestPixel) {
  const TemporaryFolder folder;
  for (const int bits : {10, 12, 14, 16}) {
    SaveFrame(folder / "f.png", Grey16(1 << bits));
    EXPECT_EQ(LoadFrame(folder / "f.png").bit_depth, bits);
  }
}
TEST(LoadFrame, ADarkSixteenBitFileStillHasTenBits) {
  const TemporaryFolder folder;
  SaveFrame(folder / "f.png", Grey16(100));
  EXPECT_EQ(LoadFrame(folder / "f.png").bit_depth, 10);
}
TEST(LoadFrame, MissingFileIsNamed) {
  EXPECT_THAT(FrameFault("/nowhere/left.png"), AllOf(HasSubstr("/nowhere/left.png: "), HasSubstr("No such file")));
}
TEST(LoadFrame, EmptyFileIsNamed) {
  const TemporaryFolder folder;
  EXPECT_THAT(FrameFault(folder.Write("left.png", "")), HasSubstr("left.png: is empty"));
}
TEST(LoadFrame, OtherFormatsAreNamed) {
  const TemporaryFolder folder;
  cv::imwrite((folder / "f.jpg").string(), Grey8());
  EXPECT_THAT(FrameFault(folder / "f.jpg"), HasSubstr("is no PNG, TIFF or binary PGM"));
  EXPECT_THAT(FrameFault(folder.Write("f.png", "P2\n2 2\n255\n1 2 3 4\n")), HasSubstr("is no PNG, TIFF or binary PGM"));
  EXPECT_THAT(FrameFault(folder.Write("f.png", "x")), HasSubstr("is no PNG"));
}
TEST(LoadFrame, ColourIsRefused) {
  const TemporaryFolder folder;
  SaveFrame(folder / "c.png", cv::Mat(8, 8, CV_8UC3, cv::Scalar(1, 2, 3)));
  WritePicture(folder / "c.tif", cv::Mat(8, 8, CV_16UC3, cv::Scalar(1, 2, 3)));
  EXPECT_THAT(FrameFault(folder / "c.png"), HasSubstr("colour picture (3 channels)"));
  EXPECT_THAT(FrameFault(folder / "c.tif"), HasSubstr("colour picture (3 channels)"));
  EXPECT_THAT(FrameFault(folder.Write("c.ppm", "P6\n1 1\n255\nabc")), HasSubstr("colour picture"));
}
TEST(LoadFrame, FloatPixelsAreRefused) {
  const TemporaryFolder folder;
  cv::imwrite((folder / "f.tif").string(), cv::Mat(8, 8, CV_32FC1, cv::Scalar(0.5)));
  EXPECT_THAT(FrameFault(folder / "f.tif"), HasSubstr("8- or 16-bit"));
}
TEST(LoadFrame, FlippedByteInAPngIsFoundByItsChecksum) {
  const TemporaryFolder folder;
  SaveFrame(folder / "f.png", Grey8());
  std::string bytes = TemporaryFolder::Read(folder / "f.png");
  bytes[bytes.size() / 2] ^= 0x10;
  EXPECT_THAT(FrameFault(folder.Write("f.png", bytes)), HasSubstr("wrong checksum"));
}
TEST(LoadFrame, CodesThatNoCompressedTiffHasAreAnError) {
  const TemporaryFolder folder;
  WritePicture(folder / "f.tif", Grey16(4096, 120, 100));
  std::string bytes = TemporaryFolder::Read(folder / "f.tif");
  // LZW codes no table holds yet; a single bit may still decode, as TIFF has no checksum.
  bytes.replace(bytes.size() / 2, 64, std::string(64, '\xfe'));
  EXPECT_THAT(FrameFault(folder.Write("f.tif", bytes)), HasSubstr("f.tif: is damaged"));
}
TEST(LoadFrame, PgmHeadersWithCommentsAndOddMaximaAreRead) {
  const TemporaryFolder folder;
  const Frame frame =
      LoadFrame(folder.Write("f.pgm", std::string("P5 # made by hand\n2\n1 4095\n\x0f\xff\x00\x01", 31)));
  EXPECT_EQ(frame.image.at<std::uint16_t>(0, 0), 4095);
  EXPECT_EQ(frame.image.at<std::uint16_t>(0, 1), 1);
  EXPECT_EQ(frame.bit_depth, 12);
}
TEST(LoadFrame, PgmWithADamagedHeaderOrTooMuchBehindIsRefused) {
  const TemporaryFolder folder;
  for (const char* text :
       {"P5\n0 4\n255\n", "P5\n2 x\n255\nab", "P5\n2 2\n70000\nabcd", "P5\n99999999999 2\n255\nabcd"}) {
    EXPECT_THAT(FrameFault(folder.Write("f.pgm", text)), HasSubstr("damaged header")) << text;
  }
  EXPECT_THAT(FrameFault(folder.Write("f.pgm", "P5\n2 2\n255\nabcde")), HasSubstr("damaged PGM"));
}
TEST(LoadFrame, TiffThatPointsNowhereIsRefused) {
  const TemporaryFolder folder;
  for (const std::string& text :
       {std::string("II*\0\xff\xff\xff\x7f________", 16), std::string("MM\0*\0\0\0\x08\xff\xff______", 16),
        std::string("II+\0\x08\0\0\0\xff\xff\xff\xff\xff\xff\xff\xff", 16)}) {
    EXPECT_THAT(FrameFault(folder.Write("f.tif", text)), HasSubstr("truncated or damaged TIFF"));
  }
}

TEST(LoadFramePair, SizesMustAgree) {
  const TemporaryFolder folder;
  SaveFrame(folder / "l.png", Grey8(40, 30));
  SaveFrame(folder / "r.png", Grey8(40, 31));
  EXPECT_THAT(FaultOf([&] { static_cast<void>(LoadFramePair(folder / "l.png", folder / "r.png")); }),
              AllOf(HasSubstr("right is 40x31"), HasSubstr("l.png) is 40x30")));
}
TEST(LoadFramePair, DepthsMustAgree) {
  const TemporaryFolder folder;
  SaveFrame(folder / "l.png", Grey8());
  SaveFrame(folder / "r.png", Grey16(4096));
  EXPECT_THAT(FaultOf([&] { static_cast<void>(LoadFramePair(folder / "l.png", folder / "r.png")); }),
              AllOf(HasSubstr("right is 16-bit"), HasSubstr("is 8-bit")));
}
TEST(LoadFramePair, TheBrighterFrameSaysTheBitDepthOfBoth) {
  const TemporaryFolder folder;
  SaveFrame(folder / "l.png", Grey16(900));
  SaveFrame(folder / "r.png", Grey16(4000));
  const FramePair pair = LoadFramePair(folder / "l.png", folder / "r.png");
  EXPECT_EQ(pair.left.bit_depth, 12);
  EXPECT_EQ(pair.right.bit_depth, 12);
}
TEST(LoadFramePair, AmbientFramesComeAlongAndMustMatch) {
  const TemporaryFolder folder;
  SaveFrame(folder / "l.png", Grey8());
  SaveFrame(folder / "small.png", Grey8(8, 8));
  const fs::path lit = folder / "l.png";
  EXPECT_TRUE(LoadFramePair(lit, lit, lit, lit).ambient_right.has_value());
  EXPECT_THAT(FaultOf([&] { static_cast<void>(LoadFramePair(lit, lit, lit, folder / "small.png")); }),
              HasSubstr("ambient right is 8x8"));
}

TEST(SaveFrame, RefusesTiff) {
  const TemporaryFolder folder;
  EXPECT_THAT(FaultOf([&] { SaveFrame(folder / "f.tif", Grey8()); }), HasSubstr(".png or .pgm"));
}
TEST(SaveFrame, RefusesWhatItCannotKeep) {
  const TemporaryFolder folder;
  EXPECT_THAT(FaultOf([&] { SaveFrame(folder / "f.png", cv::Mat()); }), HasSubstr("empty"));
  EXPECT_THAT(FaultOf([&] { SaveFrame(folder / "f.png", cv::Mat(2, 2, CV_32FC1, cv::Scalar(0))); }),
              HasSubstr("8- or 16-bit"));
  EXPECT_THAT(FaultOf([&] { SaveFrame(folder / "f.jpg", Grey8()); }), HasSubstr(".png or .pgm"));
  EXPECT_THAT(FaultOf([&] { SaveFrame(folder / "f.pgm", cv::Mat(2, 2, CV_8UC3, cv::Scalar(0))); }),
              HasSubstr("grey only"));
}

// ---------------------------------------------------------------- writing whole or not at all

TEST(WriteBytes, MissingFolderIsNamed) {
  EXPECT_THAT(FaultOf([] { WriteBytes("/nowhere/at/all.txt", "x"); }), HasSubstr("there is no folder /nowhere/at"));
}
TEST(WriteBytes, AFullDiskIsAnError) {
  EXPECT_THAT(FaultOf([] { WriteBytes("/dev/full", "x"); }), HasSubstr("No space left"));
}
TEST(WriteBytes, AFolderCannotBeReplaced) {
  const TemporaryFolder folder;
  EXPECT_THAT(FaultOf([&] { WriteBytes(folder.path(), "x"); }), HasSubstr("is a folder"));
}
TEST(WriteBytes, ReplacesAndLeavesNothingElseBehind) {
  const TemporaryFolder folder;
  WriteBytes(folder / "f", "old and longer");
  WriteBytes(folder / "f", "new");
  EXPECT_EQ(ReadBytes(folder / "f"), "new");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 1);
}
TEST(WriteBytes, WritesThroughALink) {
  const TemporaryFolder folder;
  WriteBytes(folder / "target", "old");
  fs::create_symlink("target", folder / "link");
  WriteBytes(folder / "link", "new");
  EXPECT_TRUE(fs::is_symlink(folder / "link"));
  EXPECT_EQ(ReadBytes(folder / "target"), "new");
}

}  // namespace
}  // namespace granary
