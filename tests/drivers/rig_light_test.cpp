// Warm-up pairs, dark pairs and shorter exposures.
#include "drivers/rig.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/drivers/rig_bench.h"

namespace granary {
namespace {

TEST(WarmUp, ThrowsTheFirstPairsAwayAfterIdling) {
  RigBench bench;
  bench.options.warmup_pairs = 2;
  for (std::uint64_t id = 1; id <= 7; ++id) bench.AddFrames(id, id);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(rig.CapturePair().left.frame_id, 3u);
  EXPECT_EQ(rig.CapturePair().left.frame_id, 4u);  // just used
  bench.steady += std::chrono::minutes(30);
  EXPECT_EQ(rig.CapturePair().left.frame_id, 7u);
  EXPECT_EQ(bench.lamp->pulses, 7);
}

TEST(WarmUp, ForgivesMissingFrames) {
  RigBench bench;
  bench.options.warmup_pairs = 1;
  bench.AddFrames(1, 1);
  bench.AddFrames(2, 2);
  bench.left->frames.front().image.release();
  Rig rig = bench.MakeRig();
  EXPECT_EQ(rig.CapturePair().left.frame_id, 2u);
}

TEST(WarmUp, DoesNotForgiveACameraThatIsGone) {
  RigBench bench;
  bench.options.warmup_pairs = 1;
  bench.left->fail_arm = Reason::kCameraUnavailable;
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kCameraUnavailable);
  EXPECT_EQ(bench.lamp->pulses, 0);
}

TEST(Ambient, ComesAlongWithTheProjectorDark) {
  RigBench bench;
  bench.options.ambient = true;
  bench.options.trigger = {TriggerMode::kLine0, TriggerMode::kLine0};
  bench.lamp->has_trigger_line = true;
  bench.AddFrames(1, 1);
  bench.AddFrames(2, 2);
  for (auto* camera : {bench.left.get(), bench.right.get()}) camera->frames.back().image.setTo(3);
  Rig rig = bench.MakeRig();
  const FramePair pair = rig.CapturePair();
  ASSERT_TRUE(pair.ambient_left && pair.ambient_right);
  EXPECT_EQ(pair.ambient_left->frame_id, 2u);
  EXPECT_EQ(bench.lamp->pulses, 1);
  EXPECT_THAT(*bench.events, testing::Contains("dark trigger"));
}

TEST(Ambient, TellsADeadLamp) {
  RigBench bench;
  bench.options.ambient = true;
  bench.lamp->has_trigger_line = true;
  bench.AddFrames(1, 1);
  bench.AddFrames(2, 2);  // as bright as the first
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kProjectorDark);
}

TEST(Ambient, IsRefusedWhereOneLineDrivesBoth) {
  RigBench bench;
  bench.options.ambient = true;
  bench.options.trigger = {TriggerMode::kLine0, TriggerMode::kLine0};
  bench.AddFrames(1, 1);
  bench.AddFrames(2, 2);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kProjectorFault);
}

// Cameras whose frames are as bright as their exposure: full at 4000 us and more.
struct Bracketing : RigBench {
  Bracketing() {
    options.exposure_brackets = 2;
    for (auto* camera : {left.get(), right.get()}) camera->grey_per_us = 255.0 / 4000;
  }
};

TEST(ExposureBrackets, AreAddedWhileThePictureSaturates) {
  const Bracketing bench;
  Rig rig = bench.MakeRig();
  const FramePair pair = rig.CapturePair();  // 8000 us is full, 2000 us half full
  EXPECT_EQ(pair.left.bit_depth, 10);
  EXPECT_EQ(pair.left.image.type(), CV_16UC1);
  EXPECT_NEAR(pair.left.image.at<std::uint16_t>(0, 0), 255.0 * 8000 / 4000, 4);  // a grey level of the shorter one
  EXPECT_EQ(bench.lamp->pulses, 2);
}

TEST(ExposureBrackets, AreRememberedAndLeftOutAgain) {
  const Bracketing bench;
  Rig rig = bench.MakeRig();
  (void)rig.CapturePair();
  (void)rig.CapturePair();
  EXPECT_EQ(bench.lamp->pulses, 4);  // both exposures without a look at the first one
  for (auto* camera : {bench.left.get(), bench.right.get()}) camera->grey_per_us = 100.0 / 8000;
  (void)rig.CapturePair();  // still both, but not needed
  (void)rig.CapturePair();
  EXPECT_EQ(bench.lamp->pulses, 7);
}

TEST(ExposureBrackets, EndAtTheirNumber) {
  const Bracketing bench;
  for (auto* camera : {bench.left.get(), bench.right.get()}) camera->grey_per_us = 255;
  Rig rig = bench.MakeRig();
  const FramePair pair = rig.CapturePair();
  EXPECT_EQ(bench.lamp->pulses, 3);
  EXPECT_EQ(pair.left.bit_depth, 12);
  EXPECT_EQ(pair.left.image.at<std::uint16_t>(0, 0), 255 * 16);  // clipped, and seen to be
}

TEST(ExposureBrackets, AreTakenOfTheDarkPairToo) {
  Bracketing bench;
  bench.options.ambient = true;
  Rig rig = bench.MakeRig();
  const FramePair pair = rig.CapturePair();
  EXPECT_EQ(pair.ambient_left->image.type(), pair.left.image.type());
  EXPECT_EQ(pair.ambient_left->bit_depth, pair.left.bit_depth);
}

TEST(ExposureBrackets, OfTheDarkPairAreThoseOfTheLitOneWhenFewerAreNeededFromNowOn) {
  Bracketing bench;
  bench.options.ambient = true;
  Rig rig = bench.MakeRig();
  (void)rig.CapturePair();
  for (auto* camera : {bench.left.get(), bench.right.get()}) camera->grey_per_us = 100.0 / 8000;
  const FramePair pair = rig.CapturePair();
  EXPECT_EQ(pair.left.bit_depth, 10);
  EXPECT_EQ(pair.ambient_left->bit_depth, 10);
}

TEST(ExposureBrackets, AreLeftOutWhereTheExposureCannotBeSetAndNobodyAsked) {
  RigBench bench;
  bench.options.exposure_brackets = 2;
  bench.AddFrames(1, 1);
  for (auto* camera : {bench.left.get(), bench.right.get()}) camera->frames.back().image.setTo(255);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(rig.CapturePair().left.bit_depth, 8);
  EXPECT_EQ(bench.lamp->pulses, 1);
}

TEST(ExposureBrackets, NeedACameraWhoseExposureCanBeSetWhereAskedFor) {
  RigBench bench;
  bench.options.exposure_brackets = 1;
  bench.options.brackets_asked_for = true;
  bench.AddFrames(1, 1);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kSettingRefused);
  EXPECT_EQ(bench.lamp->pulses, 0);
}

}  // namespace
}  // namespace granary
