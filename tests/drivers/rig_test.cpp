#include "drivers/rig.h"

#include <functional>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/drivers/fakes.h"

namespace granary {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
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

TEST(CapturePair, GivesTheLengthOfThePulse) {
  const Bench bench;
  bench.AddFrames(1, 1);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(rig.CapturePair().pulse, kPulse);
}

TEST(CapturePair, LeavesPulseAndSkewUnknownWhereNothingTellsThem) {
  const Bench bench;
  bench.AddFrames(1, 1);
  bench.left->frames.front().exposure_start = {};
  Rig rig(std::make_unique<FakeCamera>(bench.left), std::make_unique<FakeCamera>(bench.right), nullptr, {});
  const FramePair pair = rig.CapturePair();
  EXPECT_FALSE(pair.skew);
  EXPECT_FALSE(pair.pulse);
}

TEST(CapturePair, RefusesAFrameExposedBeforeThePulse) {
  const Bench bench;
  bench.AddFrames(1, 1);
  bench.left->frames.front().exposure_start = bench.lamp->now - kMaxSkew - microseconds(1);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kStrayTrigger);
  bench.ExpectSafe();
}

TEST(CapturePair, RefusesAFrameExposedBeyondThePulse) {
  const Bench bench;
  bench.AddFrames(1, 1);
  bench.right->frames.front().exposure_end = bench.lamp->now + kPulse + kMaxSkew + microseconds(1);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kStrayTrigger);
  EXPECT_EQ(rig.counters().mismatched, 1u);
}

TEST(CapturePair, RefusesCamerasThatBothCountedMoreTriggersThanWereGiven) {
  const Bench bench;
  bench.AddFrames(10, 20);
  bench.AddFrames(14, 24);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
  EXPECT_EQ(ReasonOf(rig), Reason::kStrayTrigger);
}

TEST(CapturePair, RefusesTheFrameOfTheLastPair) {
  const Bench bench;
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
  const Bench bench;
  bench.AddFrames(100, 207);
  bench.AddFrames(1, 2);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
}

TEST(CapturePair, RefusesOneCounterThatBeganAnew) {
  const Bench bench;
  bench.AddFrames(100, 207);
  bench.AddFrames(101, 2);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kOk);
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
}

// The cameras' own clocks have no common zero: what counts is the time since the pair before.
struct OwnClocks : Bench {
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
struct FreeRunning : Bench {
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

TEST(CapturePair, CommandsTheCamerasWhileThePulseIsOn) {
  const Bench bench;
  bench.AddFrames(1, 1);
  bench.left->note_triggers = bench.right->note_triggers = true;
  Rig rig = bench.MakeRig();
  (void)rig.CapturePair();
  EXPECT_THAT(*bench.events, ElementsAre("left arm", "right arm", "projector pulse", "left trigger", "right trigger",
                                         "left grab", "right grab", "left disarm", "right disarm"));
}

TEST(CapturePair, SaysWhenNeitherCameraGaveAFrame) {
  const Bench bench;
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
  const Bench bench;
  bench.right->frames.push_back(Bench::MakeFrame(1, kNow));
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kFrameMissing);
  EXPECT_THAT(rig.counters().missed_frames, ElementsAre(1u, 0u));
}

TEST(WarmUp, ThrowsTheFirstPairsAwayAfterIdling) {
  Bench bench;
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
  Bench bench;
  bench.options.warmup_pairs = 1;
  bench.AddFrames(1, 1);
  bench.AddFrames(2, 2);
  bench.left->frames.front().image.release();
  Rig rig = bench.MakeRig();
  EXPECT_EQ(rig.CapturePair().left.frame_id, 2u);
}

TEST(WarmUp, DoesNotForgiveACameraThatIsGone) {
  Bench bench;
  bench.options.warmup_pairs = 1;
  bench.left->fail_arm = Reason::kCameraUnavailable;
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kCameraUnavailable);
  EXPECT_EQ(bench.lamp->pulses, 0);
}

TEST(Ambient, ComesAlongWithTheProjectorDark) {
  Bench bench;
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
  Bench bench;
  bench.options.ambient = true;
  bench.lamp->has_trigger_line = true;
  bench.AddFrames(1, 1);
  bench.AddFrames(2, 2);  // as bright as the first
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kProjectorDark);
}

TEST(Ambient, IsRefusedWhereOneLineDrivesBoth) {
  Bench bench;
  bench.options.ambient = true;
  bench.options.trigger = {TriggerMode::kLine0, TriggerMode::kLine0};
  bench.AddFrames(1, 1);
  bench.AddFrames(2, 2);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kProjectorFault);
}

// Cameras whose frames are as bright as their exposure: full at 4000 us and more.
struct Bracketing : Bench {
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
  Bench bench;
  bench.options.exposure_brackets = 2;
  bench.AddFrames(1, 1);
  for (auto* camera : {bench.left.get(), bench.right.get()}) camera->frames.back().image.setTo(255);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(rig.CapturePair().left.bit_depth, 8);
  EXPECT_EQ(bench.lamp->pulses, 1);
}

TEST(ExposureBrackets, NeedACameraWhoseExposureCanBeSetWhereAskedFor) {
  Bench bench;
  bench.options.exposure_brackets = 1;
  bench.options.brackets_asked_for = true;
  bench.AddFrames(1, 1);
  Rig rig = bench.MakeRig();
  EXPECT_EQ(ReasonOf(rig), Reason::kSettingRefused);
  EXPECT_EQ(bench.lamp->pulses, 0);
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
