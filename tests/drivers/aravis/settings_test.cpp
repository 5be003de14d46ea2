// What a camera is set to, and how it is refused.
#include "tests/drivers/aravis/aravis_test.h"

namespace granary {
namespace {

using testing::AllOf;
using testing::HasSubstr;
class Settings : public AravisTest {};

TEST_F(Settings, ReachTheCamera) {
  const FakeGige fake;
  CameraOptions options = AravisOptions();
  options.exposure_us = 1234;
  options.roi_px = {16, 32, 320, 200};
  const CameraAravis camera(options, TriggerMode::kSoftware, kSize);
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_EXPOSURE_TIME_US), 1234u);
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_X_OFFSET), 16u);
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_Y_OFFSET), 32u);
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_WIDTH), 320u);
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_HEIGHT), 200u);
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_GAIN_MODE), 1u);  // automatic gain off
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_TRIGGER_MODE), 1u);
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_TRIGGER_SOURCE), 1u);
  EXPECT_EQ(fake.Register(0x0d04) & 0xffff, 8000u);  // packet size
}

TEST_F(Settings, SwitchTheTriggerOffForACameraThatRunsFree) {
  FakeGige fake;
  fake.SetRegister(ARV_FAKE_CAMERA_REGISTER_TRIGGER_MODE, 1);
  const CameraAravis camera(AravisOptions(), TriggerMode::kFree, kSize);
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_TRIGGER_MODE), 0u);
}

TEST_F(Settings, SwitchTriggersOfOtherKindsOff) {
  FakeGige fake;
  fake.SetRegister(ARV_FAKE_CAMERA_REGISTER_TRIGGER_MODE + ARV_FAKE_CAMERA_REGISTER_ACQUISITION_START_OFFSET, 1);
  const CameraAravis camera(AravisOptions(), TriggerMode::kLine0, kSize);
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_TRIGGER_MODE + ARV_FAKE_CAMERA_REGISTER_ACQUISITION_START_OFFSET),
            0u);
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_TRIGGER_MODE), 1u);
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_TRIGGER_SOURCE), 0u);
}

TEST_F(Settings, TakeTheGainInDecibelsWhereTheCameraHasThem) {
  const FakeGige fake({.more_features = true});
  CameraOptions options = AravisOptions();
  options.gain_db = 6.5;
  EXPECT_EQ(RefusalOf(options).words, "");
  options.gain_db = 30;
  EXPECT_THAT(RefusalOf(options).words, AllOf(HasSubstr("gain_db: "), HasSubstr("allowed is 0 to 24")));
}

TEST_F(Settings, RefuseDecibelsToACameraThatCountsSteps) {
  const FakeGige fake;
  CameraOptions options = AravisOptions();
  options.gain_db = 6;
  const Refusal refusal = RefusalOf(options);
  EXPECT_EQ(refusal.reason, Reason::kSettingRefused);
  EXPECT_THAT(refusal.words, AllOf(HasSubstr("gain_db: "), HasSubstr("features.GainRaw")));
}

TEST_F(Settings, OfAnUnknownPixelFormatAreRefusedWithWhatIsOffered) {
  const FakeGige fake;
  CameraOptions options = AravisOptions();
  for (const char* format : {"Mono12", "BayerRG8", "nonsense"}) {
    options.pixel_format = format;
    const Refusal refusal = RefusalOf(options);
    EXPECT_EQ(refusal.reason, Reason::kSettingRefused);
    EXPECT_THAT(refusal.words, AllOf(HasSubstr(std::string("pixel_format: \"") + format + "\""),
                                     HasSubstr("allowed is Mono8, Mono16")));
  }
}

TEST_F(Settings, OfASizeThatTheSensorHasNotAreRefused) {
  const FakeGige fake;
  CameraOptions options = AravisOptions();
  EXPECT_THAT(RefusalOf(options, TriggerMode::kSoftware, cv::Size(4096, 3000)).words,
              AllOf(HasSubstr("roi_px: 4096x3000"), HasSubstr("2048x2048")));
  options.roi_px = {1900, 0, 320, 240};
  EXPECT_THAT(RefusalOf(options).words, HasSubstr("roi_px: 320x240 from (1900, 0) does not fit"));
}

TEST_F(Settings, OfAnExposureOutOfRangeAreRefused) {
  const FakeGige fake;
  CameraOptions options = AravisOptions();
  options.exposure_us = 3;
  const Refusal refusal = RefusalOf(options);
  EXPECT_EQ(refusal.reason, Reason::kSettingRefused);
  EXPECT_THAT(refusal.words, AllOf(HasSubstr("exposure_us: "), HasSubstr("allowed is 10 to 10000000")));
}

TEST_F(Settings, OfTheExposureCanBeChangedWhileOpen) {
  const FakeGige fake;
  CameraAravis camera(AravisOptions(), TriggerMode::kSoftware, kSize);
  EXPECT_TRUE(camera.SetExposure(2000));
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_EXPOSURE_TIME_US), 2000u);
  EXPECT_EQ(ErrorOf([&] { camera.SetExposure(1e9); }).reason, Reason::kSettingRefused);
  EXPECT_TRUE(IsWhole(Shoot(camera).image, 1));
}

TEST_F(Settings, OfFeaturesAreMadeInTheirOrder) {
  const FakeGige fake;
  CameraOptions options = AravisOptions();
  // Both go through one register, so the later one is what stays.
  options.features = {{"TestBoolean", true}, {"TestRegister", std::int64_t{77}}};
  { const CameraAravis camera(options, TriggerMode::kSoftware, kSize); }
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_TEST), 77u);
  options.features = {{"TestRegister", std::int64_t{77}}, {"TestBoolean", true}};
  { const CameraAravis camera(options, TriggerMode::kSoftware, kSize); }
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_TEST), 321u);
}

TEST_F(Settings, OfFeaturesOfEveryKindAreMade) {
  const FakeGige fake({.more_features = true});
  CameraOptions options = AravisOptions();
  options.features = {{"GainRaw", std::int64_t{5}}, {"AcquisitionFrameRate", 12.5}, {"GainAuto", "Once"},
                      {"TestStringReg", "wheat"},   {"TriggerSoftware", true},      {"PtpEnable", true},
                      {"Gain", std::int64_t{3}}};
  EXPECT_EQ(RefusalOf(options).words, "");
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_GAIN_RAW), 5u);
  EXPECT_EQ(fake.Register(ARV_FAKE_CAMERA_REGISTER_GAIN_MODE), 3u);
}

TEST_F(Settings, OfAFeatureThatTheCameraLacksAreRefused) {
  const FakeGige fake;
  CameraOptions options = AravisOptions();
  options.features = {{"SharpnessAuto", true}};
  const Refusal refusal = RefusalOf(options);
  EXPECT_EQ(refusal.reason, Reason::kSettingRefused);
  EXPECT_THAT(refusal.words, HasSubstr("features.SharpnessAuto: the camera has no SharpnessAuto"));
}

TEST_F(Settings, OfAFeatureWithABadValueAreRefusedWithWhatIsAllowed) {
  const FakeGige fake;
  CameraOptions options = AravisOptions();
  options.features = {{"BinningHorizontal", std::int64_t{99}}};
  EXPECT_THAT(RefusalOf(options).words, AllOf(HasSubstr("features.BinningHorizontal: "), HasSubstr("1 to 16")));
  options.features = {{"GainAuto", "Sometimes"}};
  EXPECT_THAT(RefusalOf(options).words, AllOf(HasSubstr("features.GainAuto: "), HasSubstr("Off, Once, Continuous")));
  options.features = {{"GainAuto", 1.5}};
  EXPECT_THAT(RefusalOf(options).words, HasSubstr("features.GainAuto: GainAuto does not take this kind of value"));
  options.features = {{"GainRaw", 1.5}};
  EXPECT_THAT(RefusalOf(options).words, HasSubstr("features.GainRaw: GainRaw wants a whole number"));
}

TEST_F(Settings, ThatTheCameraChangesInSilenceAreRefused) {
  const FakeGige fake({.more_features = true});
  CameraOptions options = AravisOptions();
  options.features = {{"Narrow", std::int64_t{20}}};
  const Refusal refusal = RefusalOf(options);
  EXPECT_EQ(refusal.reason, Reason::kSettingRefused);
  EXPECT_THAT(refusal.words, HasSubstr("features.Narrow: the camera made 4 of Narrow = 20"));
}

TEST_F(Settings, OfPtpAreRefusedToACameraWithoutIt) {
  const FakeGige fake;
  CameraOptions options = AravisOptions();
  options.ptp = true;
  const Refusal refusal = RefusalOf(options);
  EXPECT_EQ(refusal.reason, Reason::kSettingRefused);
  EXPECT_THAT(refusal.words, HasSubstr("ptp: the camera does not follow PTP"));
}

TEST_F(Settings, OfAPacketDelayReachTheCamera) {
  const FakeGige fake;
  CameraOptions options = AravisOptions();
  options.packet_delay_ns = 5000;
  const CameraAravis camera(options, TriggerMode::kSoftware, kSize);
  EXPECT_EQ(fake.Register(kPacketDelayRegister), 5000u);
}

TEST_F(Settings, OfTwoCamerasOnOneLinkShareIt) {
  const FakeGige left({.address = "127.0.0.1", .serial = "L"}), right({.address = "127.0.0.2", .serial = "R"});
  CameraOptions left_options = AravisOptions("127.0.0.1");
  left_options.packet_delay_ns = 111;
  CameraAravis left_camera(left_options, TriggerMode::kSoftware, kSize);
  CameraAravis right_camera(AravisOptions("127.0.0.2"), TriggerMode::kSoftware, kSize);
  CameraAravis::ShareLink(left_camera, right_camera);
  EXPECT_EQ(left.Register(kPacketDelayRegister), 111u) << "the configuration's own stays";
  // 8038 bytes on a wire of 1 Gbit/s, of which 450 Mbit/s are its own.
  EXPECT_NEAR(right.Register(kPacketDelayRegister), 8038 * 8 / 0.45 - 8038 * 8, 1);
  EXPECT_TRUE(IsWhole(Shoot(right_camera).image, 1));
}

}  // namespace
}  // namespace granary
