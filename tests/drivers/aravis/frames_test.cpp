// What comes over GVSP when nothing is broken.
#include <atomic>
#include <thread>

#include "tests/drivers/aravis/aravis_test.h"

namespace granary {
namespace {

using testing::HasSubstr;
class Frames : public AravisTest {};

TEST_F(Frames, ArriveToTheLastBitInMono8) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  const Frame frame = Shoot(camera);
  EXPECT_EQ(frame.image.type(), CV_8UC1);
  EXPECT_EQ(frame.image.size(), kSize);
  EXPECT_EQ(frame.bit_depth, 8);
  EXPECT_TRUE(IsWhole(frame.image, 1));
}

TEST_F(Frames, ArriveToTheLastBitInMono16) {
  const FakeGige fake;
  CameraOptions options = AravisOptions();
  options.pixel_format = "Mono16";
  CameraAravis camera(options, TriggerMode::kSoftware, kSize);
  const Frame frame = Shoot(camera);
  EXPECT_EQ(frame.image.type(), CV_16UC1);
  EXPECT_EQ(frame.bit_depth, 16);
  EXPECT_TRUE(IsWhole(frame.image, 1));
}

TEST_F(Frames, ArriveInTheCamerasOwnPacketSize) {
  const FakeGige fake;
  CameraOptions options = AravisOptions();
  options.packet_size = 0;
  CameraAravis camera(options, TriggerMode::kSoftware, cv::Size(64, 48));
  EXPECT_TRUE(IsWhole(Shoot(camera).image, 1));
}

TEST_F(Frames, AreAsLargeAsTheSensorWhereNobodySaysOtherwise) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, cv::Size());
  EXPECT_EQ(ShootUntilItComes(camera).image.size(), cv::Size(2048, 2048));
}

TEST_F(Frames, ComeOneForEachTriggerAndCountByOne) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, cv::Size(16, 16));
  std::uint64_t before = Shoot(camera).frame_id;
  // The fake begins at 65400: its 16 bits begin anew on the way.
  for (int i = 0; i < 200; ++i) {
    const Frame frame = Shoot(camera);
    ASSERT_EQ(frame.frame_id, before + 1) << i;
    before = frame.frame_id;
  }
  EXPECT_EQ(fake.FramesMade(), 201);
}

TEST_F(Frames, ComeOneATrigger) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  camera.Arm();
  camera.Trigger();
  (void)camera.Grab(kLong);
  const Refusal second = ErrorOf([&] { (void)camera.Grab(kShort); });
  EXPECT_EQ(second.reason, Reason::kFrameMissing);
}

TEST_F(Frames, TellTheCamerasOwnTimeAndNoneOfTheHosts) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  const Frame first = Shoot(camera), second = Shoot(camera);
  ASSERT_TRUE(first.device_time && second.device_time);
  EXPECT_GT(*second.device_time, *first.device_time);
  EXPECT_EQ(first.exposure_start, UtcTime{});
  EXPECT_EQ(first.exposure_end, UtcTime{});
}

TEST_F(Frames, OfTheFakeAreMarkedSimulatedAndNamedById) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  const Frame frame = Shoot(camera);
  EXPECT_TRUE(frame.simulated);
  EXPECT_EQ(frame.source, "127.0.0.1");
  EXPECT_FALSE(frame.temperature_c);
}

TEST_F(Frames, BringTheTemperatureWhereTheCameraHasIt) {
  FakeGige fake({.more_features = true});
  fake.SetRegister(0x8000, 41);
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  EXPECT_EQ(Shoot(camera).temperature_c, 41.0);
}

TEST_F(Frames, FromBeforeArmAreNeverReturned) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  for (int shot = 1; shot <= 5; ++shot) {
    camera.Arm();
    camera.Trigger();  // nobody grabs what it makes
    while (fake.FramesMade() < 2 * shot - 1) std::this_thread::yield();
    EXPECT_EQ(FrameNumber(Shoot(camera).image), 2 * shot - 1);
  }
}

TEST_F(Frames, ThatNobodyGrabbedDoNotUseUpTheBuffers) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  for (int i = 0; i < 30; ++i) {
    camera.Arm();
    camera.Trigger();
    while (fake.FramesMade() < i + 1) std::this_thread::yield();
    camera.Disarm();
  }
  EXPECT_EQ(FrameNumber(Shoot(camera).image), 30);
}

TEST_F(Frames, ComeFreelyFromACameraThatRunsFree) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kFree, kSize);
  camera.Arm();
  const Frame first = camera.Grab(kLong), second = camera.Grab(kLong);
  EXPECT_GT(FrameNumber(second.image), FrameNumber(first.image));
  EXPECT_TRUE(IsWhole(second.image, 1));
}

TEST_F(Frames, StopWhereACameraThatRunsFreeIsDisarmed) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kFree, kSize);
  camera.Arm();
  (void)camera.Grab(kLong);
  camera.Disarm();
  // Acquisition of the fake.
  EXPECT_EQ(fake.Register(0x124), 0u);
}

TEST_F(Frames, DoNotComeFromALineThatNobodyPulls) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kLine0, kSize);
  camera.Arm();
  camera.Trigger();  // means nothing to a camera that a line triggers
  const Refusal none = ErrorOf([&] { (void)camera.Grab(kShort); });
  EXPECT_EQ(none.reason, Reason::kFrameMissing);
  EXPECT_THAT(none.words, HasSubstr("no frame came within 300 ms"));
}

TEST_F(Frames, DoNotComeUnlessArmed) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  EXPECT_EQ(ErrorOf([&] { (void)camera.Grab(kLong); }).reason, Reason::kFrameMissing);
  (void)Shoot(camera);
  EXPECT_EQ(ErrorOf([&] { (void)camera.Grab(kLong); }).reason, Reason::kFrameMissing);
}

TEST_F(Frames, AreNotWaitedForAfterAnInterrupt) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kLine0, kSize);
  camera.Arm();
  std::thread other([&] {
    std::this_thread::sleep_for(milliseconds(50));
    camera.Interrupt();
  });
  const Refusal interrupted = ErrorOf([&] { (void)camera.Grab(std::chrono::hours(1)); });
  other.join();
  EXPECT_EQ(interrupted.reason, Reason::kFrameMissing);
  EXPECT_THAT(interrupted.words, HasSubstr("interrupted"));
}

TEST_F(Frames, OfTwoCamerasAreNeverExchanged) {
  const FakeGige left({.address = "127.0.0.1", .serial = "L", .mark = 7});
  const FakeGige right({.address = "127.0.0.2", .serial = "R", .mark = 9});
  CameraAravis right_camera(AravisOptions("Aravis-R"), TriggerMode::kSoftware, kSize);
  CameraAravis left_camera(AravisOptions("Aravis-L"), TriggerMode::kSoftware, kSize);
  for (int i = 0; i < 10; ++i) {
    left_camera.Arm();
    right_camera.Arm();
    left_camera.Trigger();
    right_camera.Trigger();
    EXPECT_TRUE(IsWhole(left_camera.Grab(kLong).image, 7));
    EXPECT_TRUE(IsWhole(right_camera.Grab(kLong).image, 9));
  }
}

class PtpFrames : public AravisTest {
 public:
  static CameraOptions WithPtp() {
    CameraOptions options = AravisOptions();
    options.ptp = true;
    return options;
  }
  static std::int64_t Now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
        .count();
  }
};

TEST_F(PtpFrames, AreRefusedUntilTheCameraIsLocked) {
  const FakeGige fake({.more_features = true});
  CameraAravis camera(WithPtp(), TriggerMode::kSoftware, kSize);
  const Refusal refusal = ErrorOf([&] { camera.Arm(); });
  EXPECT_EQ(refusal.reason, Reason::kCameraUnavailable);
  EXPECT_THAT(refusal.words, HasSubstr("ptp: the status is Listening"));
}

TEST_F(PtpFrames, AreRefusedWhereTheHostFollowsAnotherClock) {
  FakeGige fake({.more_features = true});
  fake.SetRegister(kPtpStatusRegister, 1);
  fake.SetLatchedTime(Now_ns() + 5'000'000'000);
  CameraAravis camera(WithPtp(), TriggerMode::kSoftware, kSize);
  EXPECT_THAT(ErrorOf([&] { camera.Arm(); }).words, HasSubstr("both must follow one master"));
}

// A clock that goes with the host's, some seconds ahead. The fake latches nothing: on a busy machine its clock has gone
// on when it is read, so it takes some tries.
Refusal ArmWithClock(FakeGige& fake, CameraAravis& camera, std::chrono::nanoseconds ahead) {
  std::atomic<bool> done{false};
  std::thread clock([&] {
    while (!done) fake.SetLatchedTime(PtpFrames::Now_ns() + ahead.count());
  });
  Refusal refusal;
  for (int i = 0; i < 5000; ++i) {
    refusal = ErrorOf([&] { camera.Arm(); });
    if (refusal.reason == Reason::kOk) break;
  }
  done = true;
  clock.join();
  return refusal;
}

TEST_F(PtpFrames, TellTheHostsTime) {
  FakeGige fake({.more_features = true});
  fake.SetRegister(kPtpStatusRegister, 1);
  CameraAravis camera(WithPtp(), TriggerMode::kSoftware, kSize);
  const Refusal refusal = ArmWithClock(fake, camera, std::chrono::seconds(0));
  ASSERT_EQ(refusal.reason, Reason::kOk) << refusal.words;
  camera.Trigger();
  const Frame frame = camera.Grab(kLong);
  EXPECT_EQ(frame.exposure_start.time_since_epoch(), *frame.device_time);
  EXPECT_EQ(frame.exposure_end - frame.exposure_start, std::chrono::microseconds(8000));
}

TEST_F(PtpFrames, AreTakenFromAClockInAtomicTime) {
  FakeGige fake({.more_features = true});
  fake.SetRegister(kPtpStatusRegister, 1);
  CameraAravis camera(WithPtp(), TriggerMode::kSoftware, kSize);
  EXPECT_EQ(ArmWithClock(fake, camera, std::chrono::seconds(37)).words, "");
  // The fake's frames bear the host's time, 37 s before Arm on the clock that was found.
  camera.Trigger();
  EXPECT_THAT(ErrorOf([&] { (void)camera.Grab(kShort); }).words, HasSubstr("1 frames from before dropped"));
}

}  // namespace
}  // namespace granary
