#include "drivers/camera_replay.h"

#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include "drivers/errors.h"
#include "drivers/rig.h"

namespace granary {
namespace {

namespace fs = std::filesystem;
constexpr std::chrono::milliseconds kTimeout{100};

class CameraReplayFiles : public testing::Test {
 protected:
  void SetUp() override {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::path(testing::TempDir()) / (std::string("granary_replay_") + test->name());
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path Picture(const std::string& name, int grey) const {
    const fs::path file = folder_ / name;
    cv::imwrite(file.string(), cv::Mat(8, 10, CV_8UC1, cv::Scalar(grey)));
    return file;
  }
  fs::path folder_;
};

Reason ReasonOfGrab(Camera& camera) {
  try {
    (void)camera.Grab(kTimeout);
    return Reason::kOk;
  } catch (const DeviceError& error) {
    return error.reason();
  }
}

TEST_F(CameraReplayFiles, GivesTheFilesInTurnRoundAndRound) {
  CameraReplay camera({Picture("a.png", 10), Picture("b.png", 20)});
  std::vector<int> greys;
  for (int i = 0; i < 5; ++i) {
    camera.Arm();
    greys.push_back(camera.Grab(kTimeout).image.at<std::uint8_t>(0, 0));
  }
  EXPECT_THAT(greys, testing::ElementsAre(10, 20, 10, 20, 10));
}

TEST_F(CameraReplayFiles, TellsTheIndexAndTheNameOfTheFile) {
  const fs::path second = Picture("b.png", 20);
  CameraReplay camera({Picture("a.png", 10), second});
  camera.Arm();
  camera.Arm();
  const Frame frame = camera.Grab(kTimeout);
  EXPECT_EQ(frame.frame_id, 1u);
  EXPECT_EQ(frame.source, second.string());
}

TEST_F(CameraReplayFiles, IsNotSimulated) {
  CameraReplay camera({Picture("a.png", 10)});
  camera.Arm();
  EXPECT_FALSE(camera.Grab(kTimeout).simulated);
}

TEST_F(CameraReplayFiles, ReportsAMissingFileWithItsName) {
  CameraReplay camera({folder_ / "absent.png"});
  camera.Arm();
  try {
    (void)camera.Grab(kTimeout);
    FAIL();
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.reason(), Reason::kFrameInvalid);
    EXPECT_THAT(error.what(), testing::HasSubstr("absent.png"));
  }
}

TEST_F(CameraReplayFiles, ReportsATruncatedFileAsInvalid) {
  const fs::path file = Picture("a.png", 10);
  fs::resize_file(file, fs::file_size(file) / 2);
  CameraReplay camera({file});
  camera.Arm();
  EXPECT_EQ(ReasonOfGrab(camera), Reason::kFrameInvalid);
}

TEST_F(CameraReplayFiles, GivesNoFrameUnlessArmed) {
  CameraReplay camera({Picture("a.png", 10)});
  EXPECT_EQ(ReasonOfGrab(camera), Reason::kFrameMissing);
}

TEST_F(CameraReplayFiles, GivesOneFrameAnArm) {
  CameraReplay camera({Picture("a.png", 10)});
  camera.Arm();
  (void)camera.Grab(kTimeout);
  EXPECT_EQ(ReasonOfGrab(camera), Reason::kFrameMissing);
}

TEST_F(CameraReplayFiles, GivesNoFrameAfterDisarm) {
  CameraReplay camera({Picture("a.png", 10)});
  camera.Arm();
  camera.Disarm();
  EXPECT_EQ(ReasonOfGrab(camera), Reason::kFrameMissing);
}

TEST(CameraReplay, NeedsAFile) { EXPECT_THROW(CameraReplay({}), std::invalid_argument); }

TEST_F(CameraReplayFiles, StaysInStepWithItsPairAcrossABadFile) {
  RigOptions options;
  options.left.driver = options.right.driver = CameraDriver::kReplay;
  options.left.files = {Picture("l0.png", 1), folder_ / "absent.png", Picture("l2.png", 3)};
  options.right.files = {Picture("r0.png", 1), Picture("r1.png", 2), Picture("r2.png", 3)};
  Rig rig = OpenRig(options, {});
  (void)rig.CapturePair();
  EXPECT_THROW((void)rig.CapturePair(), DeviceError);
  const FramePair pair = rig.CapturePair();
  EXPECT_EQ(pair.left.image.at<std::uint8_t>(0, 0), pair.right.image.at<std::uint8_t>(0, 0));
}

}  // namespace
}  // namespace granary
