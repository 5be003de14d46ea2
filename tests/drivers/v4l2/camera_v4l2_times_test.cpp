#include "drivers/camera_v4l2.h"

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/drivers/v4l2/bench.h"

namespace granary {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

TEST(CameraV4l2, ReportsAFreeCameraThatWasPulledBetweenPairs) {
  V4l2Bench bench;
  bench.node->runs_free_ms = 10;
  const auto camera = bench.Open(TriggerMode::kFree);
  camera->Arm();
  camera->Disarm();
  bench.node->Unplug();
  EXPECT_EQ(ReasonOf([&] { camera->Arm(); }), Reason::kCameraUnavailable);
}

// On a line the frame tells its stamp alone: how long its rows took is not known to a millisecond.
TEST(CameraV4l2, TellsOfTriggeredFramesTheStampAlone) {
  V4l2Bench bench;
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

Window WindowOf(V4l2Bench& bench) {
  bench.node->runs_free_ms = 33;
  const auto camera = bench.Open(TriggerMode::kFree);
  camera->Arm();
  const Frame frame = camera->Grab(kTimeout);
  const UtcTime stamp = bench.Utc(*frame.device_time);
  return {stamp - frame.exposure_start, frame.exposure_end - stamp};
}

TEST(CameraV4l2, PutsTheExposureBeforeAStampOfTheFramesEnd) {
  V4l2Bench bench;
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = ExposureControl();
  const Window window = WindowOf(bench);
  EXPECT_EQ(window.before, milliseconds(33 + 8));
  EXPECT_EQ(window.after, milliseconds(0));
}

TEST(CameraV4l2, PutsTheExposureAfterAStampOfItsStart) {
  V4l2Bench bench;
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = ExposureControl();
  bench.node->stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  const Window window = WindowOf(bench);
  EXPECT_EQ(window.before, milliseconds(0));
  EXPECT_EQ(window.after, milliseconds(33 + 8));
}

// It flags start of exposure and stamps the first packet, unless told to use the camera's clock.
TEST(CameraV4l2, TrustsTheStampOfUvcvideoOnNeitherSide) {
  V4l2Bench bench;
  bench.node->driver = "uvcvideo";
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = ExposureControl();
  bench.node->stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  const Window window = WindowOf(bench);
  EXPECT_EQ(window.before, milliseconds(33 + 8));
  EXPECT_EQ(window.after, milliseconds(33 + 8));
}

TEST(CameraV4l2, TakesAnUnknownExposureAsAWholeFrameInterval) {
  V4l2Bench bench;
  const Window window = WindowOf(bench);
  EXPECT_EQ(window.before, milliseconds(33 + 33));
}

TEST(CameraV4l2, MeasuresTheFrameIntervalWhereTheDriverTellsNone) {
  V4l2Bench bench;
  bench.node->interval_ms = 0;
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = ExposureControl();
  EXPECT_EQ(WindowOf(bench).before, milliseconds(33 + 8));
}

TEST(CameraV4l2, TellsNoTimeOfAnUnknownClock) {
  for (const std::uint32_t clock : {V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN, V4L2_BUF_FLAG_TIMESTAMP_COPY}) {
    V4l2Bench bench;
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

TEST(CameraV4l2, BelievesAStampThatIsALittleAheadOfTheClock) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kLine0);
  camera->Arm();
  bench.node->to_come.emplace_back([&](FakeNode& n) {
    const auto now = bench.system.now;
    bench.system.now += std::chrono::milliseconds(20);
    n.SendGrey(1);
    bench.system.now = now;
  });
  EXPECT_NE(camera->Grab(kTimeout).device_time, std::nullopt);
}

TEST(CameraV4l2, TellsNoTimeOfAStampFarAheadOfTheClock) {
  V4l2Bench bench;
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
    V4l2Bench bench;
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
  V4l2Bench bench;
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
  V4l2Bench bench;
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
  V4l2Bench bench;
  bench.node->to_come.emplace_back([](FakeNode& n) { n.SendGrey(1, V4L2_BUF_FLAG_ERROR); });
  bench.node->to_come.emplace_back([](FakeNode& n) { n.Send({1, 2, 3}); });
  bench.WillSend({7});
  const auto camera = bench.Open(TriggerMode::kFree);
  camera->Arm();
  EXPECT_EQ(camera->counters().spoilt, 2u);
  EXPECT_TRUE(bench.node->to_come.empty());
}

TEST(CameraV4l2, MissesTheFirstFrameOfAFreeCameraThatIsSilent) {
  V4l2Bench bench;
  const auto camera = bench.Open(TriggerMode::kFree);
  EXPECT_EQ(ReasonOf([&] { camera->Arm(); }), Reason::kFrameMissing);
}

TEST(CameraV4l2, LetsFramesOfTheOldExposurePass) {
  V4l2Bench bench;
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
  V4l2Bench bench;
  EXPECT_FALSE(bench.Open(TriggerMode::kLine0)->SetExposure(2000));
}

}  // namespace
}  // namespace granary
