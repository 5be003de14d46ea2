#include "drivers/camera_v4l2.h"

#include <cerrno>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/drivers/v4l2/bench.h"

namespace granary {
namespace {

// v4l2loopback keeps its last picture for whoever comes.
TEST(CameraV4l2, DropsAFrameThatTheDriverKeptFromBeforeArm) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->to_come.emplace_back([&](FakeNode& n) {
    const auto now = bench.system.now;
    bench.system.now -= std::chrono::seconds(60);
    n.SendGrey(1);
    bench.system.now = now;
  });
  bench.WillSend({2});
  EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), 2);
  EXPECT_EQ(camera->counters().stale, 1u);
}

TEST(CameraV4l2, MissesTheFrameOfASilentCamera) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  const auto before = bench.system.now;
  EXPECT_EQ(ReasonOf([&] { (void)camera->Grab(kTimeout); }), Reason::kFrameMissing);
  EXPECT_EQ(bench.system.now - before, kTimeout);
}

TEST(CameraV4l2, WorksOnAfterAMissedFrame) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  EXPECT_THROW((void)camera->Grab(kTimeout), DeviceError);
  camera->Disarm();
  camera->Arm();
  bench.WillSend({9});
  EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), 9);
}

TEST(CameraV4l2, DropsThePictureThatADriverWithoutClockKept) {
  V4l2Bench bench;
  bench.node->keeps_last = true;
  bench.node->stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_COPY;
  const auto camera = bench.Open(TriggerMode::kLine0);
  for (const int grey : {1, 2, 3}) {
    camera->Arm();
    bench.WillSend({grey});
    EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), grey);
    camera->Disarm();
  }
}

TEST(CameraV4l2, DropsFramesThatTheDriverFlags) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->to_come.emplace_back([](FakeNode& n) { n.SendGrey(1, V4L2_BUF_FLAG_ERROR); });
  bench.WillSend({2});
  EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), 2);
  EXPECT_EQ(camera->counters().spoilt, 1u);
}

TEST(CameraV4l2, DropsFramesThatAreTooShort) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->to_come.emplace_back([](FakeNode& n) { n.Send(std::vector<std::uint8_t>(31)); });
  EXPECT_THAT(WordsOf([&] { (void)camera->Grab(kTimeout); }),
              testing::AllOf(testing::HasSubstr("no frame within 500 ms"), testing::HasSubstr("31 bytes")));
  EXPECT_EQ(camera->counters().spoilt, 1u);
}

TEST(CameraV4l2, DropsBuffersThatClaimMoreThanTheyHold) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->to_come.emplace_back([](FakeNode& n) { n.Send(std::vector<std::uint8_t>(33)); });
  EXPECT_EQ(ReasonOf([&] { (void)camera->Grab(kTimeout); }), Reason::kFrameMissing);
}

TEST(CameraV4l2, DropsTheFirstFramesWhenTheyAreNoPictures) {
  V4l2Bench bench;
  bench.node->formats = {{"Y10", {{8, 4}}}};
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.WillSend({0xFFFF, 0xFFFF, 0x3FF});
  EXPECT_EQ(camera->Grab(kTimeout).image.at<std::uint16_t>(0, 0), 0x3FF);
  EXPECT_EQ(camera->counters().spoilt, 2u);
}

TEST(CameraV4l2, SaysThatTheFormatIsWrongWhenPicturesNeverFitIt) {
  V4l2Bench bench;
  bench.node->formats = {{"Y10", {{8, 4}}}};
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.WillSend({0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF});
  EXPECT_EQ(ReasonOf([&] { (void)camera->Grab(kTimeout); }), Reason::kFrameInvalid);
}

TEST(CameraV4l2, KeepsAllItsBuffersThroughSpoiltFrames) {
  V4l2Bench bench;
  bench.node->formats = {{"Y10", {{8, 4}}}};
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  for (int i = 0; i < 20; ++i) {
    bench.WillSend({0xFFFF});
    EXPECT_THROW((void)camera->Grab(kTimeout), DeviceError);
  }
  EXPECT_EQ(bench.node->queued.size(), bench.node->buffers.size());
}

TEST(CameraV4l2, ReportsACameraThatWasPulledWhileIdle) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  bench.node->Unplug();
  EXPECT_EQ(ReasonOf([&] { camera->Arm(); }), Reason::kCameraUnavailable);
}

TEST(CameraV4l2, ReportsACameraThatWasPulledWhileArmed) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->Unplug();
  EXPECT_EQ(ReasonOf([&] { (void)camera->Grab(kTimeout); }), Reason::kCameraUnavailable);
}

TEST(CameraV4l2, ReportsACameraThatIsPulledWhileItWaits) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->to_come.emplace_back([](FakeNode& n) { n.Unplug(); });
  EXPECT_THAT(WordsOf([&] { (void)camera->Grab(kTimeout); }),
              testing::AllOf(testing::HasSubstr(kPath), testing::HasSubstr("No such device")));
  camera->Disarm();
}

TEST(CameraV4l2, WorksAgainWhenOpenedAnewAfterItWasPulled) {
  V4l2Bench bench;
  auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->Unplug();
  EXPECT_THROW((void)camera->Grab(kTimeout), DeviceError);
  camera.reset();
  EXPECT_EQ(ReasonOf([&] { (void)bench.Open(TriggerMode::kLine0); }), Reason::kCameraUnavailable);
  bench.node = bench.system.Plug(kPath);
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = ExposureControl();
  camera = bench.Open(TriggerMode::kLine0);
  EXPECT_EQ(bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE].value, 80);  // set up all anew
  camera->Arm();
  bench.WillSend({3});
  EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), 3);
}

TEST(CameraV4l2, FindsItsCameraBehindALinkAfterTheNodeWasRenumbered) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::path(testing::TempDir()) / "granary_v4l2_renumbered";
  fs::remove_all(folder);
  fs::create_directories(folder);
  for (const char* name : {"video0", "video1"}) std::ofstream(folder / name) << "";
  fs::create_symlink("video0", folder / "by-id");
  FakeV4l2 system;
  CameraOptions options = Options();
  options.id = folder / "by-id";
  const auto old_node = system.Plug(folder / "video0");
  {
    CameraV4l2 camera(options, TriggerMode::kLine0, {}, system);
    old_node->Unplug();
    EXPECT_EQ(ReasonOf([&] { camera.Arm(); }), Reason::kCameraUnavailable);
  }
  const auto new_node = system.Plug(folder / "video1");
  fs::remove(folder / "by-id");
  fs::create_symlink("video1", folder / "by-id");
  CameraV4l2 camera(options, TriggerMode::kLine0, {}, system);
  camera.Arm();
  new_node->to_come.emplace_back([](FakeNode& n) { n.SendGrey(8); });
  EXPECT_EQ(GreyOf(camera.Grab(kTimeout)), 8);
  fs::remove_all(folder);
}

TEST(CameraV4l2, SaysThatAnotherProgramHoldsTheCamera) {
  for (const unsigned long step : {VIDIOC_S_FMT, VIDIOC_REQBUFS}) {
    V4l2Bench bench;
    bench.node->fails[step] = EBUSY;
    EXPECT_EQ(ReasonOf([&] { (void)bench.Open(TriggerMode::kLine0); }), Reason::kCameraInUse);
    EXPECT_EQ(bench.system.open_fds(), 0u);
  }
  V4l2Bench bench;
  bench.node->fails[VIDIOC_STREAMON] = EBUSY;
  const auto camera = bench.Open(TriggerMode::kLine0);
  EXPECT_EQ(ReasonOf([&] { camera->Arm(); }), Reason::kCameraInUse);
}

TEST(CameraV4l2, IsInUseWhileAnotherOfOursHasIt) {
  V4l2Bench bench;
  auto first = bench.Open(TriggerMode::kLine0);
  EXPECT_EQ(ReasonOf([&] { (void)bench.Open(TriggerMode::kLine0); }), Reason::kCameraInUse);
  first.reset();
  EXPECT_EQ(ReasonOf([&] { (void)bench.Open(TriggerMode::kLine0); }), Reason::kOk);
}

TEST(CameraV4l2, StartsAgainAfterAStartThatFailed) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  bench.node->fails[VIDIOC_STREAMON] = EPROTO;
  EXPECT_EQ(ReasonOf([&] { camera->Arm(); }), Reason::kCameraUnavailable);
  camera->Disarm();
  bench.node->fails.clear();
  camera->Arm();
  bench.WillSend({4});
  EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), 4);
}

TEST(CameraV4l2, SaysThatTheUsbBusIsFull) {
  V4l2Bench bench;
  bench.node->fails[VIDIOC_STREAMON] = ENOSPC;
  const auto camera = bench.Open(TriggerMode::kLine0);
  EXPECT_THAT(WordsOf([&] { camera->Arm(); }), testing::HasSubstr("no bandwidth left"));
}

TEST(CameraV4l2, RefusesASoftwareTrigger) {
  V4l2Bench bench;
  const auto open = [&] { (void)bench.Open(TriggerMode::kSoftware); };
  EXPECT_EQ(ReasonOf(open), Reason::kSettingRefused);
  EXPECT_THAT(WordsOf(open), testing::HasSubstr("trigger: a V4L2 node knows no software trigger; must be \"line0\""));
}

TEST(CameraV4l2, EndsAGrabThatWaitsWhenInterrupted) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  std::promise<void> waiting;
  bench.system.before_real_wait = [&] { waiting.set_value(); };
  std::thread other([&] {
    waiting.get_future().wait();
    camera->Interrupt();
  });
  EXPECT_THAT(WordsOf([&] { (void)camera->Grab(std::chrono::seconds(60)); }), testing::HasSubstr("interrupted"));
  other.join();
}

TEST(CameraV4l2, ForgetsAnInterruptWhenArmedAnew) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Interrupt();
  camera->Arm();
  bench.WillSend({6});
  EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), 6);
}

}  // namespace
}  // namespace granary
