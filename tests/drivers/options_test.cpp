#include "drivers/options.h"

#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace granary {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::StartsWith;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

RigOptions SimRig() {
  RigOptions options;
  options.projector.driver = ProjectorDriver::kSim;
  return options;
}

TEST(FaultsOfCamera, AcceptsTheDefaults) { EXPECT_THAT(Faults(CameraOptions{}), IsEmpty()); }

TEST(FaultsOfCamera, WantsAnIdOfARealCamera) {
  CameraOptions options;
  options.driver = CameraDriver::kV4l2;
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("id: ")));
}

TEST(FaultsOfCamera, RefusesExposureAndGainThatAreNotNumbers) {
  CameraOptions options;
  options.exposure_us = options.gain_db = kNan;
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("exposure_us: "), StartsWith("gain_db: ")));
}

TEST(FaultsOfCamera, WantsFilesForReplay) {
  CameraOptions options;
  options.driver = CameraDriver::kReplay;
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("files: ")));
}

TEST(FaultsOfCamera, WantsFilesForReplayOnly) {
  CameraOptions options;
  options.files = {"a.png"};
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("files: ")));
}

TEST(FaultsOfProjector, AcceptsTheDefaults) { EXPECT_THAT(Faults(ProjectorOptions{}), IsEmpty()); }

TEST(FaultsOfProjector, WantsAChipForGpio) {
  ProjectorOptions options;
  options.driver = ProjectorDriver::kGpio;
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("chip: ")));
}

TEST(FaultsOfProjector, RefusesValuesOutOfRange) {
  ProjectorOptions options;
  options.line = -1;
  options.settle = std::chrono::microseconds(-1);
  options.max_on = std::chrono::milliseconds(0);
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("line: "), StartsWith("settle_us: "), StartsWith("max_on_ms: ")));
}

TEST(FaultsOfSim, AcceptsTheDefaults) { EXPECT_THAT(Faults(SimOptions{}), IsEmpty()); }

TEST(FaultsOfSim, RefusesValuesThatAreNotNumbers) {
  SimOptions options;
  options.volume_m3 = options.volume_step_m3 = options.full_well_e = options.read_noise_e = options.ambient = kNan;
  EXPECT_THAT(Faults(options),
              ElementsAre(StartsWith("volume_m3: "), StartsWith("volume_step_m3: "), StartsWith("full_well_e: "),
                          StartsWith("read_noise_e: "), StartsWith("ambient: ")));
}

TEST(FaultsOfSim, WantsAStepForAMotion) {
  SimOptions options;
  options.motion = SimMotion::kCycle;
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("volume_step_m3: ")));
}

TEST(FaultsOfRig, AcceptsASimulatedRig) { EXPECT_THAT(Faults(SimRig()), IsEmpty()); }

TEST(FaultsOfRig, AcceptsASimulatedRigWithoutProjector) { EXPECT_THAT(Faults(RigOptions{}), IsEmpty()); }

TEST(FaultsOfRig, RefusesOneSimulatedCamera) {
  RigOptions options;
  options.right.driver = CameraDriver::kReplay;
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("right.driver: ")));
}

TEST(FaultsOfRig, RefusesASimulatedProjectorOverRealCameras) {
  RigOptions options = SimRig();
  options.left.driver = options.right.driver = CameraDriver::kAravis;
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("projector.driver: ")));
}

TEST(FaultsOfRig, RefusesARealProjectorOverSimulatedCameras) {
  RigOptions options;
  options.projector.driver = ProjectorDriver::kGpio;
  options.projector.chip = "gpiochip0";
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("projector.driver: ")));
}

TEST(FaultsOfRig, RefusesReplaysOfDifferentLength) {
  RigOptions options;
  options.left.driver = options.right.driver = CameraDriver::kReplay;
  options.left.files = {"a.png", "b.png"};
  options.right.files = {"c.png"};
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("right.files: ")));
}

TEST(FaultsOfRig, RefusesAnExposureLongerThanTheProjectorMayBeLit) {
  RigOptions options = SimRig();
  options.right.exposure_us = 49'801;  // 200 us to settle, 50 ms allowed
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("projector.max_on_ms: ")));
}

TEST(FaultsOfRig, RefusesOneCameraOnBothSides) {
  RigOptions options;
  options.left.driver = options.right.driver = CameraDriver::kV4l2;
  options.left.id = options.right.id = "/dev/video0";
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("right.id: ")));
  options.right.id = "/dev/video2";
  EXPECT_THAT(Faults(options), IsEmpty());
}

TEST(FaultsOfCamera, RefusesASoftwareTriggerOfAV4l2Node) {
  CameraOptions options;
  options.driver = CameraDriver::kV4l2;
  options.id = "/dev/video0";
  options.trigger = TriggerMode::kSoftware;
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("trigger: ")));
}

TEST(FaultsOfRig, RefusesANegativeSkew) {
  RigOptions options;
  options.max_skew = std::chrono::microseconds(-1);
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("max_skew_us: ")));
}

TEST(FaultsOfRig, RefusesANamelessRig) {
  RigOptions options;
  options.name.clear();
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("name: ")));
}

TEST(TriggerOf, IsTheLineUnderAGpioProjectorAndElseWhatTheCameraCan) {
  CameraOptions aravis, v4l2;
  aravis.driver = CameraDriver::kAravis;
  v4l2.driver = CameraDriver::kV4l2;
  ProjectorOptions gpio;
  gpio.driver = ProjectorDriver::kGpio;
  EXPECT_EQ(TriggerOf(aravis, gpio), TriggerMode::kLine0);
  EXPECT_EQ(TriggerOf(v4l2, gpio), TriggerMode::kLine0);
  EXPECT_EQ(TriggerOf(aravis, {}), TriggerMode::kSoftware);
  EXPECT_EQ(TriggerOf(v4l2, {}), TriggerMode::kFree);
  v4l2.trigger = TriggerMode::kLine0;
  EXPECT_EQ(TriggerOf(v4l2, {}), TriggerMode::kLine0);
}

TEST(PulseWidth, LastsAsLongAsItMayForACameraThatRunsFree) {
  RigOptions options;
  options.left.driver = options.right.driver = CameraDriver::kV4l2;
  options.right.trigger = TriggerMode::kFree;
  options.projector.driver = ProjectorDriver::kGpio;
  EXPECT_EQ(PulseWidth(options), std::chrono::milliseconds(50));
}

TEST(FaultsOfRig, RefusesADarkPairWhereOneLineLightsAndTriggers) {
  RigOptions options;
  options.left.driver = options.right.driver = CameraDriver::kAravis;
  options.left.id = "Vendor-1";
  options.right.id = "Vendor-2";
  options.projector.driver = ProjectorDriver::kGpio;
  options.projector.chip = "gpiochip0";
  options.ambient = true;
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("ambient: ")));
  options.projector.trigger_line = 5;
  EXPECT_THAT(Faults(options), IsEmpty());
}

TEST(FaultsOfRig, RefusesBracketsAndDarkPairsOfFiles) {
  RigOptions options;
  options.left.driver = options.right.driver = CameraDriver::kReplay;
  options.left.files = options.right.files = {"a.png"};
  options.ambient = true;
  options.exposure_brackets = 1;
  options.warmup_pairs = 21;
  EXPECT_THAT(Faults(options),
              ElementsAre(StartsWith("warmup_pairs: "), StartsWith("exposure_brackets: "), StartsWith("ambient: ")));
}

TEST(FaultsOfCamera, RefusesWhatOnlyOtherDriversHave) {
  CameraOptions options;  // sim
  options.features = {{"BlackLevel", 2.0}};
  options.ptp = true;
  options.roi_px = {0, 0, 0, 10};
  options.packet_size = 100;
  options.packet_delay_ns = -1;
  options.socket_buffer_kib = 1;
  EXPECT_THAT(Faults(options),
              ElementsAre(StartsWith("roi_px: "), StartsWith("packet_size: "), StartsWith("packet_delay_ns: "),
                          StartsWith("socket_buffer_kib: "), StartsWith("features: "), StartsWith("ptp: ")));
}

TEST(FaultsOfProjector, RefusesOneLineForBothAndNoDuty) {
  ProjectorOptions options;
  options.line = options.trigger_line = 3;
  options.max_duty_percent = 0;
  EXPECT_THAT(Faults(options), ElementsAre(StartsWith("max_duty_percent: "), StartsWith("trigger_line: ")));
}

TEST(PulseWidth, CoversTheSettlingAndTheLongerExposure) {
  RigOptions options;
  options.left.exposure_us = 5000;
  options.right.exposure_us = 7000.2;
  EXPECT_EQ(PulseWidth(options), std::chrono::microseconds(7201));
}

}  // namespace
}  // namespace granary
