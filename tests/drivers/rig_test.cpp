#include "drivers/rig.h"

#include <functional>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/drivers/fakes.h"

namespace granary {
namespace {

using std::chrono::microseconds;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr microseconds kMaxSkew{500};
constexpr microseconds kPulse{8200};
const UtcTime kNow{std::chrono::seconds(1'800'000'000)};

// A rig of fakes, its parts in view.
struct Bench {
  Bench() {
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
  void AddFrames(std::uint64_t left_id, std::uint64_t right_id, microseconds right_late = microseconds(0)) const {
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

// The reason of the DeviceError that `capture` throws; kOk when it throws none.
Reason ReasonOf(Rig& rig) {
  try {
    (void)rig.CapturePair();
    return Reason::kOk;
  } catch (const DeviceError& error) {
    return error.reason();
  }
}

TEST(CapturePair, ArmsBothBeforeItPulsesOnceAndDisarmsAfterGrabbing) {
  const Bench bench;
  bench.AddFrames(1, 1);
  Rig rig = bench.MakeRig();
  (void)rig.CapturePair();
  EXPECT_THAT(*bench.events, ElementsAre("left arm", "right arm", "projector pulse", "left grab", "right grab",
                                         "left disarm", "right disarm"));
}

TEST(CapturePair, PulsesForTheConfiguredWidth) {
  const Bench bench;
  bench.AddFrames(1, 1);
  Rig rig = bench.MakeRig();
  (void)rig.CapturePair();
  EXPECT_EQ(bench.lamp->width, kPulse);
}

TEST(CapturePair, GivesBothFramesAndTheirSkew) {
  const Bench bench;
  bench.AddFrames(3, 9, microseconds(120));
  Rig rig = bench.MakeRig();
  const FramePair pair = rig.CapturePair();
  EXPECT_EQ(pair.left.frame_id, 3u);
  EXPECT_EQ(pair.right.frame_id, 9u);
  EXPECT_EQ(pair.skew, microseconds(120));
}

TEST(CapturePair, WithoutAProjectorGivesNoPulse) {
  const Bench bench;
  bench.AddFrames(1, 1);
  Rig rig(std::make_unique<FakeCamera>(bench.left), std::make_unique<FakeCamera>(bench.right), nullptr, {});
  (void)rig.CapturePair();
  EXPECT_EQ(bench.lamp->pulses, 0);
}

TEST(CapturePair, ReportsAMissingLeftFrameAndDisarms) {
  const Bench bench;
  bench.right->frames.push_back(Bench::MakeFrame(1, kNow));
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  bench.ExpectSafe();
}

TEST(CapturePair, ReportsAMissingRightFrameAndDisarms) {
  const Bench bench;
  bench.left->frames.push_back(Bench::MakeFrame(1, kNow));
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  bench.ExpectSafe();
}

TEST(CapturePair, ReportsAFrameWithoutPixelsAsMissing) {
  const Bench bench;
  bench.AddFrames(1, 1);
  bench.right->frames.front().image.release();
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  bench.ExpectSafe();
}

TEST(CapturePair, PassesOnWhatTheRightGrabThrowsAndDisarms) {
  const Bench bench;
  bench.AddFrames(1, 1);
  bench.right->fail_grab = Reason::kCameraUnavailable;
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kCameraUnavailable);
  bench.ExpectSafe();
}

TEST(CapturePair, DisarmsAndStaysDarkWhenTheLeftArmThrows) {
  const Bench bench;
  bench.left->fail_arm = Reason::kCameraUnavailable;
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kCameraUnavailable);
  EXPECT_EQ(bench.lamp->pulses, 0);
  bench.ExpectSafe();
}

TEST(CapturePair, DisarmsAndStaysDarkWhenTheRightArmThrows) {
  const Bench bench;
  bench.right->fail_arm = Reason::kCameraUnavailable;
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kCameraUnavailable);
  EXPECT_EQ(bench.lamp->pulses, 0);
  bench.ExpectSafe();
}

TEST(CapturePair, DisarmsWhenThePulseThrows) {
  const Bench bench;
  bench.AddFrames(1, 1);
  bench.lamp->fail_pulse = Reason::kProjectorFault;
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kProjectorFault);
  bench.ExpectSafe();
}

TEST(CapturePair, DisarmsWhenThePulseIsLongerThanTheProjectorAllows) {
  const Bench bench;
  bench.lamp->max_on = kPulse - microseconds(1);
  Rig rig = bench.MakeRig();
  EXPECT_THROW((void)rig.CapturePair(), std::invalid_argument);
  bench.ExpectSafe();
}

TEST(CapturePair, AcceptsASkewAtTheLimit) {
  const Bench bench;
  bench.AddFrames(1, 1, kMaxSkew);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
}

TEST(CapturePair, RefusesASkewBeyondTheLimitInEitherDirection) {
  const Bench bench;
  bench.AddFrames(1, 1, kMaxSkew + microseconds(1));
  bench.AddFrames(2, 2, -kMaxSkew - microseconds(1));
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kSkewTooLarge);
  EXPECT_EQ(ReasonOf(rig), Reason::kSkewTooLarge);
  bench.ExpectSafe();
}

TEST(CapturePair, NamesBothCamerasAndTheLimitWhenTheSkewIsTooLarge) {
  const Bench bench;
  bench.AddFrames(1, 1, microseconds(900));
  Rig rig = bench.MakeRig();
  try {
    (void)rig.CapturePair();
    FAIL();
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("left and right"), HasSubstr("900 us"), HasSubstr("500 us")));
  }
}

TEST(CapturePair, RefusesFramesWhoseCountersAdvancedDifferently) {
  const Bench bench;
  bench.AddFrames(10, 20);
  bench.AddFrames(11, 22);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  bench.ExpectSafe();
}

TEST(CapturePair, RecoversFromOneLostFrame) {
  const Bench bench;
  bench.AddFrames(10, 20);
  bench.AddFrames(11, 22);
  bench.AddFrames(12, 23);
  Rig rig = bench.MakeRig();
  (void)ReasonOf(rig);
  (void)ReasonOf(rig);
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
}

TEST(CapturePair, DoesNotCompareCountersAcrossAFailedCapture) {
  const Bench bench;
  bench.AddFrames(10, 20);
  Rig rig = bench.MakeRig();
  (void)ReasonOf(rig);
  bench.left->frames.push_back(Bench::MakeFrame(11, kNow));  // the right one is missing, its counter stands still
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  bench.AddFrames(12, 21);
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
}

TEST(CapturePair, LetsCamerasThatDoNotCountPass) {
  const Bench bench;
  bench.AddFrames(10, 0);
  bench.AddFrames(11, 0);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
}

TEST(CapturePair, GivesUntimedFramesTheTimeOfTheTrigger) {
  const Bench bench;
  bench.AddFrames(1, 1);
  bench.left->frames.front().exposure_start = {};
  bench.right->frames.front().exposure_start = {};
  Rig rig = bench.MakeRig();
  const FramePair pair = rig.CapturePair();
  EXPECT_EQ(pair.left.exposure_start, kNow);
  EXPECT_EQ(pair.right.exposure_start, kNow);
}

TEST(CapturePair, TakesOneBitDepthForDeepFramesFromFiles) {
  const Bench bench;
  bench.AddFrames(1, 1);
  for (auto* camera : {bench.left.get(), bench.right.get()}) {
    camera->frames.front().exposure_start = {};
    camera->frames.front().image = cv::Mat(4, 6, CV_16UC1, cv::Scalar(900));
    camera->frames.front().bit_depth = 10;
  }
  bench.right->frames.front().bit_depth = 12;
  Rig rig = bench.MakeRig();
  EXPECT_EQ(rig.CapturePair().left.bit_depth, 12);
}

TEST(Interrupt, EndsACaptureThatWaitsForAFrame) {
  const Bench bench;
  bench.AddFrames(1, 1);
  bench.right->block_grab = true;
  Rig rig = bench.MakeRig();
  Reason reason = Reason::kOk;
  std::thread capture([&] { reason = ReasonOf(rig); });
  bench.right->grabbing.get_future().wait();
  rig.Interrupt();
  capture.join();
  EXPECT_EQ(reason, Reason::kFrameMissing);
  bench.ExpectSafe();
}

}  // namespace
}  // namespace granary
