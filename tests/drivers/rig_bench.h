// A rig of fakes, for the tests of what it does with them.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/rig.h"
#include "tests/drivers/fakes.h"

namespace granary {

inline constexpr std::chrono::microseconds kMaxSkew{500};
inline constexpr std::chrono::microseconds kPulse{8200};
inline const UtcTime kNow{std::chrono::seconds(1'800'000'000)};

/// A rig of fakes, its parts in view.
struct RigBench {
  RigBench() {
    for (auto* camera : {left.get(), right.get()}) camera->events = events;
    left->id = "left";
    right->id = "right";
    lamp->events = events;
    lamp->now = kNow - std::chrono::milliseconds(2);
    options.max_skew = kMaxSkew;
    options.pulse_width = kPulse;
  }
  [[nodiscard]] Rig MakeRig() const {
    return Rig(
        std::make_unique<FakeCamera>(left), std::make_unique<FakeCamera>(right), std::make_unique<FakeProjector>(lamp),
        options, [] { return kNow; }, [this] { return steady; });
  }
  void AddFrames(std::uint64_t left_id, std::uint64_t right_id,
                 std::chrono::microseconds right_late = std::chrono::microseconds(0)) const {
    left->frames.push_back(MakeFrame(left_id, kNow));
    right->frames.push_back(MakeFrame(right_id, kNow + right_late));
  }
  static Frame MakeFrame(std::uint64_t id, UtcTime start) {
    Frame frame;
    frame.image = cv::Mat(4, 6, CV_8UC1, cv::Scalar(7));
    frame.frame_id = id;
    frame.exposure_start = start;
    return frame;
  }
  void ExpectSafe() const {
    EXPECT_FALSE(left->armed);
    EXPECT_FALSE(right->armed);
    EXPECT_FALSE(lamp->lit);
    EXPECT_THAT(*events, testing::IsSupersetOf({std::string("left disarm"), std::string("right disarm")}));
  }
  CaptureOptions options;
  std::chrono::steady_clock::time_point steady{};
  std::shared_ptr<EventLog> events = std::make_shared<EventLog>();
  std::shared_ptr<FakeCameraState> left = std::make_shared<FakeCameraState>();
  std::shared_ptr<FakeCameraState> right = std::make_shared<FakeCameraState>();
  std::shared_ptr<FakeProjectorState> lamp = std::make_shared<FakeProjectorState>();
};

/// The reason of the DeviceError that `capture` throws; kOk when it throws none.
inline Reason ReasonOf(Rig& rig) {
  try {
    (void)rig.CapturePair();
    return Reason::kOk;
  } catch (const DeviceError& error) {
    return error.reason();
  }
}

}  // namespace granary
