#include "drivers/camera_v4l2.h"

#include <dirent.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/drivers/v4l2/bench.h"

namespace granary {
namespace {

TEST(CameraV4l2, GivesTheFrameThatCameAfterArm) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.WillSend({77});
  const Frame frame = camera->Grab(kTimeout);
  EXPECT_EQ(cv::norm(frame.image, cv::Mat(4, 8, CV_8UC1, cv::Scalar(77)), cv::NORM_INF), 0);
  EXPECT_EQ(frame.source, kPath);
  EXPECT_FALSE(frame.simulated);
}

TEST(CameraV4l2, GivesFramesOldestFirst) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  for (int grey = 1; grey <= 3; ++grey) bench.node->SendGrey(grey);
  for (int grey = 1; grey <= 3; ++grey) EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), grey);
}

TEST(CameraV4l2, KeepsPixelsWhenTheBufferIsFilledAgain) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.WillSend({1, 2, 3, 4, 5, 6});
  const Frame first = camera->Grab(kTimeout);
  for (int i = 0; i < 5; ++i) (void)camera->Grab(kTimeout);
  EXPECT_EQ(GreyOf(first), 1);
}

TEST(CameraV4l2, ReadsRowsWithPadding) {
  V4l2Bench bench;
  bench.node->row_padding = 8;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->to_come.emplace_back([](FakeNode& n) {
    auto bytes = n.Grey(5);
    for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = i % 16 < 8 ? 5 : 0xEE;
    n.Send(bytes);
  });
  EXPECT_EQ(cv::norm(camera->Grab(kTimeout).image, cv::Mat(4, 8, CV_8UC1, cv::Scalar(5)), cv::NORM_INF), 0);
}

TEST(CameraV4l2, TellsTheBitsOfItsFormat) {
  V4l2Bench bench;
  bench.node->formats = {{"Y12", {{8, 4}}}};
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->pix.sizeimage = 64;
  bench.WillSend({0xABC});
  const Frame frame = camera->Grab(kTimeout);
  EXPECT_EQ(frame.bit_depth, 12);
  EXPECT_EQ(frame.image.at<std::uint16_t>(3, 7), 0xABC);
}

TEST(CameraV4l2, StreamsFromArmToDisarmOnALine) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  EXPECT_FALSE(bench.node->streaming);
  camera->Arm();
  EXPECT_TRUE(bench.node->streaming);
  camera->Disarm();
  EXPECT_FALSE(bench.node->streaming);
}

TEST(CameraV4l2, NeverGivesAFrameFromBeforeArm) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->SendGrey(1);
  camera->Disarm();
  camera->Arm();
  bench.WillSend({2});
  EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), 2);
}

TEST(CameraV4l2, GivesNoFrameUnlessArmed) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  EXPECT_EQ(ReasonOf([&] { (void)camera->Grab(kTimeout); }), Reason::kFrameMissing);
}

TEST(CameraV4l2, GivesNoFrameAfterDisarm) {
  V4l2Bench bench;
  bench.node->runs_free_ms = 10;
  const auto camera = bench.Open(TriggerMode::kFree);
  camera->Arm();
  camera->Disarm();
  EXPECT_EQ(ReasonOf([&] { (void)camera->Grab(kTimeout); }), Reason::kFrameMissing);
}

std::vector<std::uint64_t> IdsOfPairs(V4l2Bench& bench, const std::vector<int>& frames_each) {
  std::vector<std::uint64_t> ids;
  const auto camera = bench.Open(TriggerMode::kLine0);
  for (const int frames : frames_each) {
    camera->Arm();
    for (int i = 1; i < frames; ++i) {
      bench.node->to_come.emplace_back([](FakeNode& n) { n.SendGrey(1, V4L2_BUF_FLAG_ERROR); });
    }
    bench.WillSend({1});
    ids.push_back(camera->Grab(kTimeout).frame_id);
    camera->Disarm();
  }
  return ids;
}

TEST(CameraV4l2, CountsOnWhereTheDriverBeginsAnewWithEachStream) {
  V4l2Bench bench;
  EXPECT_THAT(IdsOfPairs(bench, {1, 1, 1, 2, 1}), testing::ElementsAre(1, 2, 3, 5, 6));
}

TEST(CameraV4l2, CountsOnWhereTheDriverCountsOn) {
  V4l2Bench bench;
  bench.node->counts_on = true;
  bench.node->sequence = 400;
  EXPECT_THAT(IdsOfPairs(bench, {1, 1, 1, 2, 1}), testing::ElementsAre(1, 2, 3, 5, 6));
}

TEST(CameraV4l2, SaysSoWhereTheDriverDoesNotCount) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  for (int i = 0; i < 3; ++i) {
    bench.node->to_come.emplace_back([](FakeNode& n) {
      n.sequence = 0;
      n.SendGrey(1);
    });
  }
  (void)camera->Grab(kTimeout);
  EXPECT_EQ(camera->Grab(kTimeout).frame_id, 0u);
  EXPECT_EQ(camera->Grab(kTimeout).frame_id, 0u);
}

TEST(CameraV4l2, CountsFramesThatTheDriverSkipped) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.WillSend({1});
  (void)camera->Grab(kTimeout);
  bench.node->sequence += 3;
  bench.WillSend({2});
  EXPECT_EQ(camera->Grab(kTimeout).frame_id, 5u);
  EXPECT_EQ(camera->counters().skipped, 3u);
}

std::size_t FilesOpen() {
  std::size_t count = 0;
  DIR* const folder = opendir("/proc/self/fd");
  while (readdir(folder) != nullptr) ++count;
  closedir(folder);
  return count;
}

TEST(CameraV4l2, LeavesNothingBehindInTenThousandCycles) {
  V4l2Bench bench;
  bench.node->runs_free_ms = 33;
  const std::size_t files = FilesOpen();
  for (int cycle = 0; cycle < 10'000; ++cycle) {
    const auto camera = bench.Open(cycle % 2 == 0 ? TriggerMode::kLine0 : TriggerMode::kFree);
    camera->Arm();
    (void)camera->Grab(kTimeout);
    if (cycle % 3 != 0) camera->Disarm();
  }
  EXPECT_EQ(bench.system.open_fds(), 0u);
  EXPECT_EQ(bench.system.mappings(), 0u);
  EXPECT_EQ(FilesOpen(), files);
}

TEST(CameraV4l2, LeavesNothingBehindWhereverItFails) {
  constexpr std::array<unsigned long, 11> kCalls{
      VIDIOC_QUERYCAP, VIDIOC_ENUM_FMT, VIDIOC_G_FMT,       VIDIOC_S_FMT, VIDIOC_REQBUFS,    VIDIOC_QUERYBUF,
      VIDIOC_QBUF,     VIDIOC_STREAMON, VIDIOC_G_EXT_CTRLS, VIDIOC_DQBUF, VIDIOC_S_EXT_CTRLS};
  const std::size_t files = FilesOpen();
  for (const unsigned long call : kCalls) {
    V4l2Bench bench;
    bench.node->runs_free_ms = 33;
    bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = ExposureControl();
    bench.node->fails[call] = ENODEV;
    EXPECT_EQ(ReasonOf([&] {
                const auto camera = bench.Open(TriggerMode::kLine0);
                camera->Arm();
                (void)camera->Grab(kTimeout);
              }),
              Reason::kCameraUnavailable);
    EXPECT_EQ(bench.system.open_fds(), 0u);
    EXPECT_EQ(bench.system.mappings(), 0u);
  }
  EXPECT_EQ(FilesOpen(), files);
}

}  // namespace
}  // namespace granary
