#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "drivers/errors.h"
#include "drivers/rig.h"
#include "drivers/sim/camera_sim.h"
#include "drivers/sim/projector_sim.h"
#include "tests/drivers/sim_worlds.h"

namespace granary {
namespace {

RigOptions SimRig() {
  RigOptions options;
  options.projector.driver = ProjectorDriver::kSim;
  return options;
}

// Deviation of the brightest part of the scene, high with dots and low without.
double Contrast(const Frame& frame) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(frame.image(cv::Rect(240, 180, 160, 140)), mean, deviation);
  return deviation[0] / mean[0];
}

// The sentence with which OpenRig refuses.
std::string Refusal(const RigOptions& options) {
  try {
    (void)OpenRig(options, SmallLabWorld());
    return "";
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
}

TEST(OpenRig, GivesSimulatedPairsUnderTheDots) {
  Rig rig = OpenRig(SimRig(), SmallLabWorld());
  const FramePair pair = rig.CapturePair();
  EXPECT_TRUE(pair.Simulated());
  EXPECT_GT(Contrast(pair.left), 0.3);
  EXPECT_GT(Contrast(pair.right), 0.3);
}

TEST(OpenRig, GivesSimulatedCamerasWithoutProjectorAmbientLightOnly) {
  Rig rig = OpenRig(RigOptions{}, SmallLabWorld());
  EXPECT_LT(Contrast(rig.CapturePair().left), 0.2);
}

TEST(OpenRig, GivesADeadLampAmbientLightOnly) {
  RigOptions options = SimRig();
  options.sim.projector_works = false;
  Rig rig = OpenRig(options, SmallLabWorld());
  EXPECT_LT(Contrast(rig.CapturePair().left), 0.2);
}

TEST(OpenRig, CountsAndTimesSimulatedShots) {
  Rig rig = OpenRig(SimRig(), SmallLabWorld());
  const FramePair first = rig.CapturePair(), second = rig.CapturePair();
  EXPECT_EQ(second.left.frame_id, first.left.frame_id + 1);
  EXPECT_EQ(second.left.frame_id, second.right.frame_id);
  EXPECT_EQ(second.left.exposure_start, second.right.exposure_start);
  EXPECT_GT(first.left.exposure_start, UtcTime{});
}

TEST(OpenRig, SetsTheExposureOfEachSimulatedCamera) {
  RigOptions options = SimRig();
  options.left.exposure_us = 2000;
  Rig rig = OpenRig(options, SmallLabWorld());
  const FramePair pair = rig.CapturePair();
  EXPECT_LT(cv::mean(pair.left.image)[0], 0.5 * cv::mean(pair.right.image)[0]);
}

TEST(OpenRig, NamesSimulatedFramesByTheConfiguredId) {
  RigOptions options = SimRig();
  options.left.id = "lab-left";
  Rig rig = OpenRig(options, SmallLabWorld());
  const FramePair pair = rig.CapturePair();
  EXPECT_EQ(pair.left.source, "lab-left");
  EXPECT_EQ(pair.right.source, "sim:right");
}

TEST(OpenRig, RefusesARealProjectorOverSimulatedCameras) {
  RigOptions options;
  options.projector.driver = ProjectorDriver::kGpio;
  EXPECT_THAT(Refusal(options), testing::HasSubstr("does not light simulated cameras"));
}

TEST(OpenRig, NamesTheGpioChipThatIsNotThere) {
  RigOptions options;
  options.left.driver = options.right.driver = CameraDriver::kReplay;
  options.left.files = options.right.files = {"a.png"};
  options.projector.driver = ProjectorDriver::kGpio;
  options.projector.chip = "no-such-chip";
  try {
    (void)OpenRig(options, {});
    FAIL() << "opened";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.reason(), Reason::kProjectorFault);
    EXPECT_THAT(error.what(), testing::HasSubstr("no-such-chip"));
  }
}

TEST(OpenRig, RefusesOneSimulatedCamera) {
  RigOptions options;
  options.right.driver = CameraDriver::kReplay;
  options.right.files = {"a.png"};
  EXPECT_THAT(Refusal(options), testing::HasSubstr("both cameras or neither"));
}

TEST(OpenRig, RefusesASimulatedProjectorOverOtherCameras) {
  RigOptions options = SimRig();
  options.left.driver = options.right.driver = CameraDriver::kReplay;
  options.left.files = options.right.files = {"a.png"};
  EXPECT_THAT(Refusal(options), testing::HasSubstr("projector.driver"));
}

class SimBenchParts : public testing::Test {
 protected:
  static SimOptions Filling() {
    SimOptions options;
    options.motion = SimMotion::kFilling;
    options.volume_step_m3 = 0.001;
    return options;
  }
  std::shared_ptr<SimBench> bench_ = std::make_shared<SimBench>(Filling(), SmallLabWorld());
  CameraSim left_{bench_, Side::kLeft, {}}, right_{bench_, Side::kRight, {}};
  ProjectorSim projector_{bench_, {}};
};
constexpr std::chrono::milliseconds kTimeout{100};
constexpr std::chrono::microseconds kWidth{8200};

TEST_F(SimBenchParts, HoldTheConfiguredVolumeAtTheFirstPulseAndAStepMoreAtTheNext) {
  projector_.Pulse(kWidth);
  EXPECT_NEAR(bench_->scene().TruthVolume_m3(), 0.019, 1e-12);
  projector_.Pulse(kWidth);
  EXPECT_NEAR(bench_->scene().TruthVolume_m3(), 0.020, 1e-12);
}

TEST_F(SimBenchParts, GiveAmbientFramesWhenTheProjectorWasNotPulsedSinceArm) {
  projector_.Pulse(kWidth);  // before, so of no use to this shot
  left_.Arm();
  EXPECT_LT(Contrast(left_.Grab(kTimeout)), 0.2);
}

TEST_F(SimBenchParts, ForgetAPulseWithTheNextArm) {
  left_.Arm();
  right_.Arm();
  projector_.Pulse(kWidth);
  (void)left_.Grab(kTimeout);
  (void)right_.Grab(kTimeout);
  left_.Arm();
  EXPECT_LT(Contrast(left_.Grab(kTimeout)), 0.2);
}

TEST_F(SimBenchParts, GiveNoFrameUnlessArmed) {
  EXPECT_THROW((void)left_.Grab(kTimeout), DeviceError);
  left_.Arm();
  left_.Disarm();
  EXPECT_THROW((void)left_.Grab(kTimeout), DeviceError);
}

TEST_F(SimBenchParts, GiveOneFrameAnArm) {
  left_.Arm();
  (void)left_.Grab(kTimeout);
  EXPECT_THROW((void)left_.Grab(kTimeout), DeviceError);
}

TEST_F(SimBenchParts, RefuseAPulseLongerThanAllowed) {
  EXPECT_THROW(projector_.Pulse(std::chrono::milliseconds(51)), std::invalid_argument);
  EXPECT_THROW(projector_.Pulse(std::chrono::microseconds(0)), std::invalid_argument);
}

}  // namespace
}  // namespace granary
