// How a rig takes a pair: what is asked of cameras and projector, in which order, and when one of them fails.
#include "drivers/rig.h"

#include <future>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/drivers/rig_bench.h"

namespace granary {
namespace {

using std::chrono::microseconds;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(CapturePair, ArmsBothBeforeItPulsesOnceAndDisarmsAfterGrabbing) {
  const RigBench bench;
  bench.AddFrames(1, 1);
  Rig rig = bench.MakeRig();
  (void)rig.CapturePair();
  EXPECT_THAT(*bench.events, ElementsAre("left arm", "right arm", "projector pulse", "left grab", "right grab",
                                         "left disarm", "right disarm"));
}

TEST(CapturePair, PulsesForTheConfiguredWidth) {
  const RigBench bench;
  bench.AddFrames(1, 1);
  Rig rig = bench.MakeRig();
  (void)rig.CapturePair();
  EXPECT_EQ(bench.lamp->width, kPulse);
}

TEST(CapturePair, WithoutAProjectorGivesNoPulse) {
  const RigBench bench;
  bench.AddFrames(1, 1);
  Rig rig(std::make_unique<FakeCamera>(bench.left), std::make_unique<FakeCamera>(bench.right), nullptr, {});
  (void)rig.CapturePair();
  EXPECT_EQ(bench.lamp->pulses, 0);
}

TEST(CapturePair, ReportsAMissingLeftFrameAndDisarms) {
  const RigBench bench;
  bench.right->frames.push_back(RigBench::MakeFrame(1, kNow));
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  bench.ExpectSafe();
}

TEST(CapturePair, ReportsAMissingRightFrameAndDisarms) {
  const RigBench bench;
  bench.left->frames.push_back(RigBench::MakeFrame(1, kNow));
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  bench.ExpectSafe();
}

TEST(CapturePair, ReportsAFrameWithoutPixelsAsMissing) {
  const RigBench bench;
  bench.AddFrames(1, 1);
  bench.right->frames.front().image.release();
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  bench.ExpectSafe();
}

TEST(CapturePair, PassesOnWhatTheRightGrabThrowsAndDisarms) {
  const RigBench bench;
  bench.AddFrames(1, 1);
  bench.right->fail_grab = Reason::kCameraUnavailable;
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kCameraUnavailable);
  bench.ExpectSafe();
}

TEST(CapturePair, DisarmsAndStaysDarkWhenTheLeftArmThrows) {
  const RigBench bench;
  bench.left->fail_arm = Reason::kCameraUnavailable;
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kCameraUnavailable);
  EXPECT_EQ(bench.lamp->pulses, 0);
  bench.ExpectSafe();
}

TEST(CapturePair, DisarmsAndStaysDarkWhenTheRightArmThrows) {
  const RigBench bench;
  bench.right->fail_arm = Reason::kCameraUnavailable;
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kCameraUnavailable);
  EXPECT_EQ(bench.lamp->pulses, 0);
  bench.ExpectSafe();
}

TEST(CapturePair, DisarmsWhenThePulseThrows) {
  const RigBench bench;
  bench.AddFrames(1, 1);
  bench.lamp->fail_pulse = Reason::kProjectorFault;
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kProjectorFault);
  bench.ExpectSafe();
}

TEST(CapturePair, DisarmsWhenThePulseIsLongerThanTheProjectorAllows) {
  const RigBench bench;
  bench.lamp->max_on = kPulse - microseconds(1);
  Rig rig = bench.MakeRig();
  EXPECT_THROW((void)rig.CapturePair(), std::invalid_argument);
  bench.ExpectSafe();
}

TEST(CapturePair, GivesUntimedFramesTheTimeOfTheTrigger) {
  const RigBench bench;
  bench.AddFrames(1, 1);
  bench.left->frames.front().exposure_start = {};
  bench.right->frames.front().exposure_start = {};
  Rig rig = bench.MakeRig();
  const FramePair pair = rig.CapturePair();
  EXPECT_EQ(pair.left.exposure_start, kNow);
  EXPECT_EQ(pair.right.exposure_start, kNow);
}

TEST(CapturePair, TakesOneBitDepthForDeepFramesFromFiles) {
  const RigBench bench;
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

TEST(CapturePair, GivesTheLengthOfThePulse) {
  const RigBench bench;
  bench.AddFrames(1, 1);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(rig.CapturePair().pulse, kPulse);
}

TEST(CapturePair, RefusesCamerasThatBothCountedMoreTriggersThanWereGiven) {
  const RigBench bench;
  bench.AddFrames(10, 20);
  bench.AddFrames(14, 24);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
  EXPECT_EQ(ReasonOf(rig), Reason::kStrayTrigger);
}

TEST(CapturePair, CommandsTheCamerasWhileThePulseIsOn) {
  const RigBench bench;
  bench.AddFrames(1, 1);
  bench.left->note_triggers = bench.right->note_triggers = true;
  Rig rig = bench.MakeRig();
  (void)rig.CapturePair();
  EXPECT_THAT(*bench.events, ElementsAre("left arm", "right arm", "projector pulse", "left trigger", "right trigger",
                                         "left grab", "right grab", "left disarm", "right disarm"));
}

TEST(CapturePair, SaysWhenNeitherCameraGaveAFrame) {
  const RigBench bench;
  Rig rig = bench.MakeRig();
  try {
    (void)rig.CapturePair();
    FAIL();
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("is it the trigger?"));
  }
  EXPECT_THAT(rig.counters().missed_frames, ElementsAre(1u, 1u));
  EXPECT_EQ(rig.counters().pulses, 1u);
  EXPECT_EQ(rig.counters().pairs, 0u);
}

TEST(CapturePair, CountsTheFrameOfTheOneSilentCamera) {
  const RigBench bench;
  bench.right->frames.push_back(RigBench::MakeFrame(1, kNow));
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  EXPECT_THAT(rig.counters().missed_frames, ElementsAre(1u, 0u));
}

TEST(Interrupt, EndsACaptureThatWaitsForAFrame) {
  const RigBench bench;
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
