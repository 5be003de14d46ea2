// PGM: what OpenCV writes is read and the other way round; faults of the header are in files_test.cpp.
#include "pipeline/pgm_file.h"

#include <cstdint>
#include <vector>

#include <gmock/gmock.h>
#include <opencv2/imgcodecs.hpp>

#include "tests/pipeline/test_pictures.h"

namespace granary {
namespace {

class EveryPgmType : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Types, EveryPgmType, testing::Values(CV_8UC1, CV_16UC1));

TEST_P(EveryPgmType, WhatIsWrittenOpencvReads) {
  const cv::Mat image = TestPicture(GetParam());
  const std::string bytes = EncodePgm(image);
  const cv::Mat back = cv::imdecode(std::vector<char>(bytes.begin(), bytes.end()), cv::IMREAD_UNCHANGED);
  EXPECT_TRUE(SamePicture(back, image));
}
TEST_P(EveryPgmType, WhatOpencvWritesIsRead) {
  const cv::Mat image = TestPicture(GetParam());
  std::vector<std::uint8_t> bytes;
  cv::imencode(".pgm", image, bytes);
  EXPECT_TRUE(SamePicture(DecodePgm("f.pgm", {reinterpret_cast<char*>(bytes.data()), bytes.size()}), image));
}
TEST(DecodePgm, AbsurdSizesAreRefused) {
  EXPECT_THAT(FaultOf([] { static_cast<void>(DecodePgm("f.pgm", "P5\n16385 1\n255\nab")); }),
              testing::HasSubstr("16385x1 pixels; 1 to 16384"));
}

}  // namespace
}  // namespace granary
