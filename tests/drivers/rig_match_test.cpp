// Which frames belong together: by the host's clock, the cameras' own, and their counters.
#include "drivers/rig.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/drivers/rig_bench.h"

namespace granary {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using testing::HasSubstr;

TEST(CapturePair, GivesBothFramesAndTheirSkew) {
  const RigBench bench;
  bench.AddFrames(3, 9, microseconds(120));
  Rig rig = bench.MakeRig();
  const FramePair pair = rig.CapturePair();
  EXPECT_EQ(pair.left.frame_id, 3u);
  EXPECT_EQ(pair.right.frame_id, 9u);
  EXPECT_EQ(pair.skew, microseconds(120));
}

TEST(CapturePair, AcceptsASkewAtTheLimit) {
  const RigBench bench;
  bench.AddFrames(1, 1, kMaxSkew);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
}

TEST(CapturePair, RefusesASkewBeyondTheLimitInEitherDirection) {
  const RigBench bench;
  bench.AddFrames(1, 1, kMaxSkew + microseconds(1));
  bench.AddFrames(2, 2, -kMaxSkew - microseconds(1));
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kSkewTooLarge);
  EXPECT_EQ(ReasonOf(rig), Reason::kSkewTooLarge);
  bench.ExpectSafe();
}

TEST(CapturePair, NamesBothCamerasAndTheLimitWhenTheSkewIsTooLarge) {
  const RigBench bench;
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
  const RigBench bench;
  bench.AddFrames(10, 20);
  bench.AddFrames(11, 22);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  bench.ExpectSafe();
}

TEST(CapturePair, RecoversFromOneLostFrame) {
  const RigBench bench;
  bench.AddFrames(10, 20);
  bench.AddFrames(11, 22);
  bench.AddFrames(12, 23);
  Rig rig = bench.MakeRig();
  (void)ReasonOf(rig);
  (void)ReasonOf(rig);
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
}

TEST(CapturePair, DoesNotCompareCountersAcrossAFailedCapture) {
  const RigBench bench;
  bench.AddFrames(10, 20);
  Rig rig = bench.MakeRig();
  (void)ReasonOf(rig);
  bench.left->frames.push_back(RigBench::MakeFrame(11, kNow));  // the right one is missing, its counter stands still
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  bench.AddFrames(12, 21);
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
}

TEST(CapturePair, LetsCamerasThatDoNotCountPass) {
  const RigBench bench;
  bench.AddFrames(10, 0);
  bench.AddFrames(11, 0);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
}

TEST(CapturePair, LeavesPulseAndSkewUnknownWhereNothingTellsThem) {
  const RigBench bench;
  bench.AddFrames(1, 1);
  bench.left->frames.front().exposure_start = {};
  Rig rig(std::make_unique<FakeCamera>(bench.left), std::make_unique<FakeCamera>(bench.right), nullptr, {});
  const FramePair pair = rig.CapturePair();
  EXPECT_FALSE(pair.skew);
  EXPECT_FALSE(pair.pulse);
}

TEST(CapturePair, RefusesAFrameExposedBeforeThePulse) {
  const RigBench bench;
  bench.AddFrames(1, 1);
  bench.left->frames.front().exposure_start = bench.lamp->now - kMaxSkew - microseconds(1);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kStrayTrigger);
  bench.ExpectSafe();
}

TEST(CapturePair, RefusesAFrameExposedBeyondThePulse) {
  const RigBench bench;
  bench.AddFrames(1, 1);
  bench.right->frames.front().exposure_end = bench.lamp->now + kPulse + kMaxSkew + microseconds(1);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kStrayTrigger);
  EXPECT_EQ(rig.counters().mismatched, 1u);
}

TEST(CapturePair, RefusesTheFrameOfTheLastPair) {
  const RigBench bench;
  bench.AddFrames(10, 20);
  bench.AddFrames(10, 21);
  bench.AddFrames(11, 22);
  bench.AddFrames(11, 22);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
}

TEST(CapturePair, AcceptsCountersThatBeganAnewTogether) {
  const RigBench bench;
  bench.AddFrames(100, 207);
  bench.AddFrames(1, 2);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
}

TEST(CapturePair, RefusesOneCounterThatBeganAnew) {
  const RigBench bench;
  bench.AddFrames(100, 207);
  bench.AddFrames(101, 2);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
}

// The cameras' own clocks have no common zero: what counts is the time since the pair before.
struct OwnClocks : RigBench {
  void Add(std::uint64_t id, microseconds left_at, microseconds right_at) const {
    AddFrames(id, id);
    for (auto* camera : {left.get(), right.get()}) camera->frames.back().exposure_start = {};
    left->frames.back().device_time = std::chrono::hours(7) + left_at;
    right->frames.back().device_time = std::chrono::hours(1) + right_at;
  }
};

TEST(CapturePair, TakesTheSkewFromTheCamerasOwnClocksSinceThePairBefore) {
  OwnClocks bench;
  bench.Add(1, microseconds(0), microseconds(0));
  bench.Add(2, microseconds(200000), microseconds(200030));
  Rig rig = bench.MakeRig();
  EXPECT_FALSE(rig.CapturePair().skew);
  EXPECT_EQ(rig.CapturePair().skew, microseconds(30));
}

TEST(CapturePair, RefusesFramesOfDifferentPulsesByTheCamerasOwnClocks) {
  OwnClocks bench;
  bench.Add(1, microseconds(0), microseconds(0));
  bench.Add(2, microseconds(200000), microseconds(400000));
  Rig rig = bench.MakeRig();
  (void)rig.CapturePair();
  EXPECT_EQ(ReasonOf(rig), Reason::kSkewTooLarge);
}

TEST(CapturePair, DoesNotTrustOwnClocksAfterALongTime) {
  OwnClocks bench;
  bench.Add(1, microseconds(0), microseconds(0));
  bench.Add(2, microseconds(9000000), microseconds(9001000));
  Rig rig = bench.MakeRig();
  (void)rig.CapturePair();
  bench.steady += std::chrono::seconds(9);
  EXPECT_FALSE(rig.CapturePair().skew);
}

// A camera that runs free: a frame every 10 ms, each exposed for 2 ms.
struct FreeRunning : RigBench {
  FreeRunning() {
    options.trigger = {TriggerMode::kFree, TriggerMode::kFree};
    options.max_skew = milliseconds(4);
  }
  void Add(std::uint64_t id, milliseconds left_start, milliseconds right_start) {
    AddFrames(id, id);
    left->frames.back().exposure_start = lamp->now + left_start;
    right->frames.back().exposure_start = lamp->now + right_start;
    for (auto* camera : {left.get(), right.get()}) {
      camera->frames.back().exposure_end = camera->frames.back().exposure_start + milliseconds(2);
    }
  }
};

TEST(CapturePair, TakesOfAFreeCameraTheFirstFrameThatLiesInThePulse) {
  FreeRunning bench;
  bench.Add(5, milliseconds(-9), milliseconds(-6));
  bench.Add(6, milliseconds(1), milliseconds(4));
  Rig rig = bench.MakeRig();
  const FramePair pair = rig.CapturePair();
  EXPECT_EQ(pair.left.frame_id, 6u);
  EXPECT_EQ(pair.right.frame_id, 6u);
  EXPECT_EQ(pair.skew, milliseconds(3));
}

TEST(CapturePair, RefusesAFreeCameraWithoutAWholeExposureInThePulse) {
  FreeRunning bench;
  bench.Add(5, milliseconds(-1), milliseconds(1));
  bench.Add(6, milliseconds(7), milliseconds(9));
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  bench.ExpectSafe();
}

TEST(CapturePair, RefusesAFreeCameraThatDoesNotTellTheTime) {
  FreeRunning bench;
  bench.AddFrames(1, 1);
  bench.left->frames.front().exposure_start = {};
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameInvalid);
}

}  // namespace
}  // namespace granary
