#include "drivers/camera_v4l2.h"

#include <dirent.h>

#include <array>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "drivers/errors.h"
#include "tests/drivers/v4l2/fake_v4l2.h"

namespace granary {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr milliseconds kTimeout{500};
const std::string kPath = "/dev/video-of-the-test";

CameraOptions Options() {
  CameraOptions options;
  options.driver = CameraDriver::kV4l2;
  options.id = kPath;
  return options;
}

FakeControl ExposureControl() { return {"Exposure Time, Absolute", V4L2_CTRL_TYPE_INTEGER, 1, 5000, 1, 157}; }

struct Bench {
  std::unique_ptr<CameraV4l2> Open(TriggerMode trigger, const CameraOptions& options = Options()) {
    return std::make_unique<CameraV4l2>(options, trigger, cv::Size(), system);
  }
  // Frames of these greys arrive one after the other while somebody waits.
  void WillSend(const std::vector<int>& greys) const {
    for (const int grey : greys) node->to_come.emplace_back([grey](FakeNode& n) { n.SendGrey(grey); });
  }
  UtcTime Utc(nanoseconds monotonic) { return system.Utc() - system.now + monotonic; }
  FakeV4l2 system;
  std::shared_ptr<FakeNode> node = system.Plug(kPath);
};

Reason ReasonOf(const std::function<void()>& call) {
  try {
    call();
    return Reason::kOk;
  } catch (const DeviceError& error) {
    return error.reason();
  }
}

std::string WordsOf(const std::function<void()>& call) {
  try {
    call();
    return "nothing was thrown";
  } catch (const DeviceError& error) {
    return error.what();
  }
}

int GreyOf(const Frame& frame) { return frame.image.at<std::uint8_t>(0, 0); }

TEST(CameraV4l2, GivesTheFrameThatCameAfterArm) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.WillSend({77});
  const Frame frame = camera->Grab(kTimeout);
  EXPECT_EQ(cv::norm(frame.image, cv::Mat(4, 8, CV_8UC1, cv::Scalar(77)), cv::NORM_INF), 0);
  EXPECT_EQ(frame.source, kPath);
  EXPECT_FALSE(frame.simulated);
}

TEST(CameraV4l2, GivesFramesOldestFirst) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  for (int grey = 1; grey <= 3; ++grey) bench.node->SendGrey(grey);
  for (int grey = 1; grey <= 3; ++grey) EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), grey);
}

TEST(CameraV4l2, KeepsPixelsWhenTheBufferIsFilledAgain) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.WillSend({1, 2, 3, 4, 5, 6});
  const Frame first = camera->Grab(kTimeout);
  for (int i = 0; i < 5; ++i) (void)camera->Grab(kTimeout);
  EXPECT_EQ(GreyOf(first), 1);
}

TEST(CameraV4l2, ReadsRowsWithPadding) {
  Bench bench;
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
  Bench bench;
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
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  EXPECT_FALSE(bench.node->streaming);
  camera->Arm();
  EXPECT_TRUE(bench.node->streaming);
  camera->Disarm();
  EXPECT_FALSE(bench.node->streaming);
}

TEST(CameraV4l2, NeverGivesAFrameFromBeforeArm) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->SendGrey(1);
  camera->Disarm();
  camera->Arm();
  bench.WillSend({2});
  EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), 2);
}

// v4l2loopback keeps its last picture for whoever comes.
TEST(CameraV4l2, DropsAFrameThatTheDriverKeptFromBeforeArm) {
  Bench bench;
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

TEST(CameraV4l2, GivesNoFrameUnlessArmed) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  EXPECT_EQ(ReasonOf([&] { (void)camera->Grab(kTimeout); }), Reason::kFrameMissing);
}

TEST(CameraV4l2, GivesNoFrameAfterDisarm) {
  Bench bench;
  bench.node->runs_free_ms = 10;
  const auto camera = bench.Open(TriggerMode::kFree);
  camera->Arm();
  camera->Disarm();
  EXPECT_EQ(ReasonOf([&] { (void)camera->Grab(kTimeout); }), Reason::kFrameMissing);
}

TEST(CameraV4l2, MissesTheFrameOfASilentCamera) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  const auto before = bench.system.now;
  EXPECT_EQ(ReasonOf([&] { (void)camera->Grab(kTimeout); }), Reason::kFrameMissing);
  EXPECT_EQ(bench.system.now - before, kTimeout);
}

TEST(CameraV4l2, WorksOnAfterAMissedFrame) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  EXPECT_THROW((void)camera->Grab(kTimeout), DeviceError);
  camera->Disarm();
  camera->Arm();
  bench.WillSend({9});
  EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), 9);
}

TEST(CameraV4l2, DropsFramesThatTheDriverFlags) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->to_come.emplace_back([](FakeNode& n) { n.SendGrey(1, V4L2_BUF_FLAG_ERROR); });
  bench.WillSend({2});
  EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), 2);
  EXPECT_EQ(camera->counters().spoilt, 1u);
}

TEST(CameraV4l2, DropsFramesThatAreTooShort) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->to_come.emplace_back([](FakeNode& n) { n.Send(std::vector<std::uint8_t>(31)); });
  EXPECT_THAT(WordsOf([&] { (void)camera->Grab(kTimeout); }),
              testing::AllOf(testing::HasSubstr("no frame within 500 ms"), testing::HasSubstr("31 bytes")));
  EXPECT_EQ(camera->counters().spoilt, 1u);
}

TEST(CameraV4l2, DropsBuffersThatClaimMoreThanTheyHold) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->to_come.emplace_back([](FakeNode& n) { n.Send(std::vector<std::uint8_t>(33)); });
  EXPECT_EQ(ReasonOf([&] { (void)camera->Grab(kTimeout); }), Reason::kFrameMissing);
}

TEST(CameraV4l2, DropsTheFirstFramesWhenTheyAreNoPictures) {
  Bench bench;
  bench.node->formats = {{"Y10", {{8, 4}}}};
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.WillSend({0xFFFF, 0xFFFF, 0x3FF});
  EXPECT_EQ(camera->Grab(kTimeout).image.at<std::uint16_t>(0, 0), 0x3FF);
  EXPECT_EQ(camera->counters().spoilt, 2u);
}

TEST(CameraV4l2, SaysThatTheFormatIsWrongWhenPicturesNeverFitIt) {
  Bench bench;
  bench.node->formats = {{"Y10", {{8, 4}}}};
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.WillSend({0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF});
  EXPECT_EQ(ReasonOf([&] { (void)camera->Grab(kTimeout); }), Reason::kFrameInvalid);
}

TEST(CameraV4l2, KeepsAllItsBuffersThroughSpoiltFrames) {
  Bench bench;
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
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  bench.node->Unplug();
  EXPECT_EQ(ReasonOf([&] { camera->Arm(); }), Reason::kCameraUnavailable);
}

TEST(CameraV4l2, ReportsACameraThatWasPulledWhileArmed) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->Unplug();
  EXPECT_EQ(ReasonOf([&] { (void)camera->Grab(kTimeout); }), Reason::kCameraUnavailable);
}

TEST(CameraV4l2, ReportsACameraThatIsPulledWhileItWaits) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->to_come.emplace_back([](FakeNode& n) { n.Unplug(); });
  EXPECT_THAT(WordsOf([&] { (void)camera->Grab(kTimeout); }),
              testing::AllOf(testing::HasSubstr(kPath), testing::HasSubstr("No such device")));
  camera->Disarm();
}

TEST(CameraV4l2, ReportsAFreeCameraThatWasPulledBetweenPairs) {
  Bench bench;
  bench.node->runs_free_ms = 10;
  const auto camera = bench.Open(TriggerMode::kFree);
  camera->Arm();
  camera->Disarm();
  bench.node->Unplug();
  EXPECT_EQ(ReasonOf([&] { camera->Arm(); }), Reason::kCameraUnavailable);
}

TEST(CameraV4l2, WorksAgainWhenOpenedAnewAfterItWasPulled) {
  Bench bench;
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
    Bench bench;
    bench.node->fails[step] = EBUSY;
    EXPECT_EQ(ReasonOf([&] { (void)bench.Open(TriggerMode::kLine0); }), Reason::kCameraInUse);
    EXPECT_EQ(bench.system.open_fds(), 0u);
  }
  Bench bench;
  bench.node->fails[VIDIOC_STREAMON] = EBUSY;
  const auto camera = bench.Open(TriggerMode::kLine0);
  EXPECT_EQ(ReasonOf([&] { camera->Arm(); }), Reason::kCameraInUse);
}

TEST(CameraV4l2, IsInUseWhileAnotherOfOursHasIt) {
  Bench bench;
  auto first = bench.Open(TriggerMode::kLine0);
  EXPECT_EQ(ReasonOf([&] { (void)bench.Open(TriggerMode::kLine0); }), Reason::kCameraInUse);
  first.reset();
  EXPECT_EQ(ReasonOf([&] { (void)bench.Open(TriggerMode::kLine0); }), Reason::kOk);
}

TEST(CameraV4l2, StartsAgainAfterAStartThatFailed) {
  Bench bench;
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
  Bench bench;
  bench.node->fails[VIDIOC_STREAMON] = ENOSPC;
  const auto camera = bench.Open(TriggerMode::kLine0);
  EXPECT_THAT(WordsOf([&] { camera->Arm(); }), testing::HasSubstr("no bandwidth left"));
}

TEST(CameraV4l2, RefusesASoftwareTrigger) {
  Bench bench;
  const auto open = [&] { (void)bench.Open(TriggerMode::kSoftware); };
  EXPECT_EQ(ReasonOf(open), Reason::kSettingRefused);
  EXPECT_THAT(WordsOf(open), testing::HasSubstr("trigger: a V4L2 node knows no software trigger; must be \"line0\""));
}

TEST(CameraV4l2, EndsAGrabThatWaitsWhenInterrupted) {
  Bench bench;
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
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Interrupt();
  camera->Arm();
  bench.WillSend({6});
  EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), 6);
}

// On a line the frame tells its stamp alone: how long its rows took is not known to a millisecond.
TEST(CameraV4l2, TellsOfTriggeredFramesTheStampAlone) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.WillSend({1});
  const Frame frame = camera->Grab(kTimeout);
  EXPECT_EQ(frame.device_time, bench.system.now);
  EXPECT_EQ(frame.exposure_start, UtcTime{});
  EXPECT_EQ(frame.exposure_end, UtcTime{});
}

struct Window {
  nanoseconds before, after;  // the stamp
};

Window WindowOf(Bench& bench) {
  bench.node->runs_free_ms = 33;
  const auto camera = bench.Open(TriggerMode::kFree);
  camera->Arm();
  const Frame frame = camera->Grab(kTimeout);
  const UtcTime stamp = bench.Utc(*frame.device_time);
  return {stamp - frame.exposure_start, frame.exposure_end - stamp};
}

TEST(CameraV4l2, PutsTheExposureBeforeAStampOfTheFramesEnd) {
  Bench bench;
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = ExposureControl();
  const Window window = WindowOf(bench);
  EXPECT_EQ(window.before, milliseconds(33 + 8));
  EXPECT_EQ(window.after, milliseconds(0));
}

TEST(CameraV4l2, PutsTheExposureAfterAStampOfItsStart) {
  Bench bench;
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = ExposureControl();
  bench.node->stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  const Window window = WindowOf(bench);
  EXPECT_EQ(window.before, milliseconds(0));
  EXPECT_EQ(window.after, milliseconds(33 + 8));
}

// It flags start of exposure and stamps the first packet, unless told to use the camera's clock.
TEST(CameraV4l2, TrustsTheStampOfUvcvideoOnNeitherSide) {
  Bench bench;
  bench.node->driver = "uvcvideo";
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = ExposureControl();
  bench.node->stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  const Window window = WindowOf(bench);
  EXPECT_EQ(window.before, milliseconds(33 + 8));
  EXPECT_EQ(window.after, milliseconds(33 + 8));
}

TEST(CameraV4l2, TakesAnUnknownExposureAsAWholeFrameInterval) {
  Bench bench;
  const Window window = WindowOf(bench);
  EXPECT_EQ(window.before, milliseconds(33 + 33));
}

TEST(CameraV4l2, MeasuresTheFrameIntervalWhereTheDriverTellsNone) {
  Bench bench;
  bench.node->interval_ms = 0;
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = ExposureControl();
  EXPECT_EQ(WindowOf(bench).before, milliseconds(33 + 8));
}

TEST(CameraV4l2, TellsNoTimeOfAnUnknownClock) {
  for (const std::uint32_t clock : {V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN, V4L2_BUF_FLAG_TIMESTAMP_COPY}) {
    Bench bench;
    bench.node->runs_free_ms = 33;
    bench.node->stamp_flags = clock;
    const auto camera = bench.Open(TriggerMode::kFree);
    camera->Arm();
    const Frame frame = camera->Grab(kTimeout);
    EXPECT_EQ(frame.exposure_start, UtcTime{});
    EXPECT_EQ(frame.exposure_end, UtcTime{});
    EXPECT_EQ(frame.device_time, std::nullopt);
  }
}

TEST(CameraV4l2, TellsNoTimeOfAStampAheadOfTheClock) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->to_come.emplace_back([&](FakeNode& n) {
    const auto now = bench.system.now;
    bench.system.now += std::chrono::hours(1);
    n.SendGrey(1);
    bench.system.now = now;
  });
  EXPECT_EQ(camera->Grab(kTimeout).device_time, std::nullopt);
}

TEST(CameraV4l2, GivesFreeFramesThatBeganAfterArmOnly) {
  for (const std::uint32_t source : {V4L2_BUF_FLAG_TSTAMP_SRC_EOF, V4L2_BUF_FLAG_TSTAMP_SRC_SOE}) {
    Bench bench;
    bench.node->runs_free_ms = 33;
    bench.node->stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | source;
    const auto camera = bench.Open(TriggerMode::kFree);
    for (int pair = 0; pair < 5; ++pair) {
      camera->Arm();
      const UtcTime armed = bench.system.Utc();
      EXPECT_GE(camera->Grab(kTimeout).exposure_start, armed);
      camera->Disarm();
      bench.system.now += milliseconds(7);
    }
  }
}

// Cameras need longer to get going than the projector may be lit.
TEST(CameraV4l2, KeepsAFreeCameraRunningBetweenPairs) {
  Bench bench;
  bench.node->runs_free_ms = 33;
  const auto camera = bench.Open(TriggerMode::kFree);
  for (int pair = 0; pair < 3; ++pair) {
    camera->Arm();
    (void)camera->Grab(kTimeout);
    camera->Disarm();
  }
  EXPECT_EQ(bench.node->starts, 1);
}

TEST(CameraV4l2, EmptiesTheFullBuffersOfAFreeCameraWhenArmed) {
  Bench bench;
  bench.node->runs_free_ms = 33;
  const auto camera = bench.Open(TriggerMode::kFree);
  camera->Arm();
  camera->Disarm();
  for (int i = 0; i < 100; ++i) bench.node->SendGrey(200);
  ASSERT_TRUE(bench.node->queued.empty());
  camera->Arm();
  EXPECT_EQ(bench.node->queued.size(), bench.node->buffers.size());
  EXPECT_EQ(GreyOf(camera->Grab(kTimeout)), 1);
}

TEST(CameraV4l2, WaitsForAFreeCamerasFirstSoundFrame) {
  Bench bench;
  bench.node->to_come.emplace_back([](FakeNode& n) { n.SendGrey(1, V4L2_BUF_FLAG_ERROR); });
  bench.node->to_come.emplace_back([](FakeNode& n) { n.Send({1, 2, 3}); });
  bench.WillSend({7});
  const auto camera = bench.Open(TriggerMode::kFree);
  camera->Arm();
  EXPECT_EQ(camera->counters().spoilt, 2u);
  EXPECT_TRUE(bench.node->to_come.empty());
}

TEST(CameraV4l2, MissesTheFirstFrameOfAFreeCameraThatIsSilent) {
  Bench bench;
  const auto camera = bench.Open(TriggerMode::kFree);
  EXPECT_EQ(ReasonOf([&] { camera->Arm(); }), Reason::kFrameMissing);
}

TEST(CameraV4l2, LetsFramesOfTheOldExposurePass) {
  Bench bench;
  bench.node->runs_free_ms = 33;
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = ExposureControl();
  const auto camera = bench.Open(TriggerMode::kFree);
  camera->Arm();
  camera->Disarm();
  EXPECT_TRUE(camera->SetExposure(2000));
  const auto before = bench.system.now;
  camera->Arm();
  EXPECT_EQ(bench.system.now - before, milliseconds(3 * 33));
  EXPECT_EQ(bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE].value, 20);
}

TEST(CameraV4l2, CannotSetAnExposureWithoutAControl) {
  Bench bench;
  EXPECT_FALSE(bench.Open(TriggerMode::kLine0)->SetExposure(2000));
}

std::vector<std::uint64_t> IdsOfPairs(Bench& bench, const std::vector<int>& frames_each) {
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
  Bench bench;
  EXPECT_THAT(IdsOfPairs(bench, {1, 1, 1, 2, 1}), testing::ElementsAre(1, 2, 3, 5, 6));
}

TEST(CameraV4l2, CountsOnWhereTheDriverCountsOn) {
  Bench bench;
  bench.node->counts_on = true;
  bench.node->sequence = 400;
  EXPECT_THAT(IdsOfPairs(bench, {1, 1, 1, 2, 1}), testing::ElementsAre(1, 2, 3, 5, 6));
}

TEST(CameraV4l2, SaysSoWhereTheDriverDoesNotCount) {
  Bench bench;
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
  Bench bench;
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
  Bench bench;
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
    Bench bench;
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
