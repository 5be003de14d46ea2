// Runs in the guest: the V4L2 driver against the kernel's virtual webcams, and what happens when they are pulled.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <iostream>
#include <optional>
#include <string>
#include <thread>

#include <opencv2/core.hpp>

#include "drivers/camera_v4l2.h"
#include "drivers/errors.h"
#include "tests/vm/footprint.h"
#include "tests/vm/vivid.h"

namespace granary {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kTimeout{20000};  // the guest is emulated; a frame takes some 30 ms in truth
constexpr int kWidth = 640, kHeight = 480;

CameraOptions Webcam() {
  CameraOptions options;
  options.driver = CameraDriver::kV4l2;
  options.id = kVividPath;
  options.pixel_format = "GREY";
  return options;
}

void Open(const CameraOptions& options) { CameraV4l2(options, TriggerMode::kFree, {kWidth, kHeight}); }

/// A whole frame from a camera opened anew.
void ExpectFrame(const CameraOptions& options) {
  CameraV4l2 camera(options, TriggerMode::kFree, {kWidth, kHeight});
  camera.Arm();
  const Frame frame = camera.Grab(kTimeout);
  EXPECT_EQ(frame.image.size(), cv::Size(kWidth, kHeight));
  camera.Disarm();
}

/// The reason of the DeviceError that `action` ends with; empty when it ends without.
std::optional<Reason> ReasonOf(const std::function<void()>& action) {
  try {
    action();
    return std::nullopt;
  } catch (const DeviceError& error) {
    std::cout << error.what() << '\n';
    return error.reason();
  }
}

/// Grabs until it throws: frames that were there before the fault may still come.
std::optional<Reason> ReasonOfGrabbing(Camera& camera) {
  return ReasonOf([&] {
    for (int i = 0; i < 100; ++i) (void)camera.Grab(milliseconds(5000));
  });
}

/// Pulls the camera, and puts it back whatever happens.
class Pulled {
 public:
  Pulled() { Unplug(); }
  ~Pulled() { Plug(); }
  Pulled(const Pulled&) = delete;
  Pulled& operator=(const Pulled&) = delete;
};

TEST(CameraV4l2, GrabsFramesOfTheSizeAskedForInOrder) {
  auto options = Webcam();
  CameraV4l2 camera(options, TriggerMode::kFree, {kWidth, kHeight});
  camera.Arm();
  std::uint64_t last = 0;
  for (int i = 0; i < 10; ++i) {
    const Frame frame = camera.Grab(kTimeout);
    ASSERT_EQ(frame.image.size(), cv::Size(kWidth, kHeight));
    ASSERT_EQ(frame.image.type(), CV_8UC1);
    ASSERT_GT(frame.frame_id, last);
    last = frame.frame_id;
  }
}

TEST(CameraV4l2, ReadsEveryFormatThatVividHas) {
  for (const char* format : {"GREY", "Y10", "Y12", "Y16", "YUYV"}) {
    auto options = Webcam();
    options.pixel_format = format;
    CameraV4l2 camera(options, TriggerMode::kFree, {kWidth, kHeight});
    camera.Arm();
    const Frame frame = camera.Grab(kTimeout);
    EXPECT_EQ(frame.image.size(), cv::Size(kWidth, kHeight)) << format;
    // Colour bars of 75 %, some formats with the narrow range of video: dark and bright whatever the bits of a pixel.
    double darkest = 0, brightest = 0;
    cv::minMaxLoc(frame.image, &darkest, &brightest);
    EXPECT_LT(darkest, 0.25 * frame.SaturationLevel()) << format;
    EXPECT_GT(brightest, 0.6 * frame.SaturationLevel()) << format;
  }
}

TEST(CameraV4l2, ExposureLiesBeforeAnEndOfFrameStamp) {
  SetControl("timestamp_source", 0);
  CameraV4l2 camera(Webcam(), TriggerMode::kFree, {kWidth, kHeight});
  const UtcTime before(std::chrono::system_clock::now());
  camera.Arm();
  const Frame frame = camera.Grab(kTimeout);
  const UtcTime after(std::chrono::system_clock::now());
  EXPECT_LT(frame.exposure_start, frame.exposure_end);
  // vivid calculates the stamp, up to a frame interval ahead: 1 s at its slowest.
  EXPECT_LE(frame.exposure_end, after + std::chrono::seconds(1));
  // Contract of Grab for a camera that runs free.
  EXPECT_GE(frame.exposure_start, before);
}

TEST(CameraV4l2, ExposureLiesAfterAStartOfExposureStamp) {
  SetControl("timestamp_source", 1);
  const UtcTime before(std::chrono::system_clock::now());
  Frame frame;
  {
    CameraV4l2 camera(Webcam(), TriggerMode::kFree, {kWidth, kHeight});
    camera.Arm();
    frame = camera.Grab(kTimeout);
  }
  const UtcTime after(std::chrono::system_clock::now());
  SetControl("timestamp_source", 0);
  EXPECT_LT(frame.exposure_start, frame.exposure_end);
  EXPECT_GE(frame.exposure_start, before);
  EXPECT_LE(frame.exposure_start, after);
}

TEST(CameraV4l2, RefusesAFormatThatTheNodeLacks) {
  auto options = Webcam();
  options.pixel_format = "MJPG";
  EXPECT_EQ(ReasonOf([&] { Open(options); }), Reason::kSettingRefused);
}

TEST(CameraV4l2, RefusesASizeThatTheNodeLacks) {
  EXPECT_EQ(ReasonOf([] { CameraV4l2 camera(Webcam(), TriggerMode::kFree, {642, 482}); }), Reason::kSettingRefused);
}

TEST(CameraV4l2, SetsControlsByName) {
  auto options = Webcam();
  options.features = {{"Brightness", std::int64_t{77}}};
  ExpectFrame(options);
}

TEST(CameraV4l2, RefusesAControlThatTheNodeLacks) {
  auto options = Webcam();
  options.features = {{"No Such Thing", std::int64_t{1}}};
  EXPECT_EQ(ReasonOf([&] { Open(options); }), Reason::kSettingRefused);
}

TEST(CameraV4l2, SaysThatAnotherProgramStreams) {
  CameraV4l2 first(Webcam(), TriggerMode::kFree, {kWidth, kHeight});
  first.Arm();
  (void)first.Grab(kTimeout);
  EXPECT_EQ(ReasonOf([] { Open(Webcam()); }), Reason::kCameraInUse);
}

TEST(CameraV4l2, SaysThatNoCameraIsThere) {
  const Pulled pulled;
  EXPECT_EQ(ReasonOf([] { Open(Webcam()); }), Reason::kCameraUnavailable);
}

TEST(CameraV4l2, PulledWhileIdleFailsAtArmAndComesBack) {
  {
    CameraV4l2 camera(Webcam(), TriggerMode::kFree, {kWidth, kHeight});
    const Pulled pulled;
    EXPECT_EQ(ReasonOf([&] { camera.Arm(); }), Reason::kCameraUnavailable);
  }
  ExpectFrame(Webcam());
}

TEST(CameraV4l2, PulledWhileArmedFailsAtGrabAndComesBack) {
  {
    CameraV4l2 camera(Webcam(), TriggerMode::kFree, {kWidth, kHeight});
    camera.Arm();
    const Pulled pulled;
    EXPECT_EQ(ReasonOfGrabbing(camera), Reason::kCameraUnavailable);
  }
  ExpectFrame(Webcam());
}

TEST(CameraV4l2, PulledWhileStreamingFailsAtGrabAndComesBack) {
  {
    CameraV4l2 camera(Webcam(), TriggerMode::kFree, {kWidth, kHeight});
    camera.Arm();
    for (int i = 0; i < 5; ++i) (void)camera.Grab(kTimeout);
    std::thread puller([] { Unplug(); });
    EXPECT_EQ(ReasonOfGrabbing(camera), Reason::kCameraUnavailable);
    puller.join();
    Plug();
  }
  ExpectFrame(Webcam());
}

TEST(CameraV4l2, DisconnectedWhileStreamingFailsAtGrabAndComesBack) {
  {
    CameraV4l2 camera(Webcam(), TriggerMode::kFree, {kWidth, kHeight});
    camera.Arm();
    (void)camera.Grab(kTimeout);
    SetControl("disconnect", 1);
    EXPECT_EQ(ReasonOfGrabbing(camera), Reason::kCameraUnavailable);
  }
  ExpectFrame(Webcam());
}

TEST(CameraV4l2, FollowsItsPathWhenTheNodeIsRenumbered) {
  const auto node = [] { return std::filesystem::canonical(kVividPath); };
  const auto was = node();
  {
    // As in life: whoever still holds the old node keeps its number from being given again.
    CameraV4l2 holder(Webcam(), TriggerMode::kFree, {kWidth, kHeight});
    Unplug();
    Plug();
  }
  EXPECT_NE(node(), was);
  ExpectFrame(Webcam());
}

TEST(CameraV4l2, CyclesLeaveNothingBehind) {
  constexpr int kWarmUp = 5, kCycles = 40;
  Footprint before;
  for (int i = 0; i < kWarmUp + kCycles; ++i) {
    if (i == kWarmUp) before = FootprintNow();
    CameraV4l2 camera(Webcam(), TriggerMode::kFree, {kWidth, kHeight});
    camera.Arm();
    (void)camera.Grab(kTimeout);
    camera.Disarm();
  }
  const Footprint after = FootprintNow();
  std::cout << kCycles << " cycles: before " << before << ", after " << after << '\n';
  EXPECT_EQ(after.descriptors, before.descriptors);
  EXPECT_LE(after.threads, before.threads);
  // One frame lost in each cycle would be 12 MB. The kernel may lay the heap in a huge page of 2 MiB at its own time,
  // which is all that was ever seen (2076 KiB more, in two of ten runs; else some 50).
  EXPECT_LT(after.rss_kib, before.rss_kib + 4096);
}

}  // namespace
}  // namespace granary
