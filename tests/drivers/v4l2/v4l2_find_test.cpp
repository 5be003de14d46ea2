#include "drivers/v4l2_find.h"

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/drivers/v4l2/fake_v4l2.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

class FindV4l2CamerasIn : public testing::Test {
 protected:
  void SetUp() override {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    dev_ = fs::path(testing::TempDir()) / (std::string("granary_v4l2_") + test->name());
    fs::remove_all(dev_);
    fs::create_directories(dev_ / "v4l/by-id");
    fs::create_directories(dev_ / "v4l/by-path");
  }
  void TearDown() override { fs::remove_all(dev_); }
  std::shared_ptr<FakeNode> Plug(const std::string& name) {
    std::ofstream(dev_ / name) << "";
    return system_.Plug(dev_ / name);
  }
  FakeV4l2 system_;
  fs::path dev_;
};

TEST_F(FindV4l2CamerasIn, NamesACameraByIdBeforePathBeforeNumber) {
  Plug("video0");
  fs::create_symlink("../../video0", dev_ / "v4l/by-id/usb-Maker_Camera_17-video-index0");
  fs::create_symlink("../../video0", dev_ / "v4l/by-path/pci-0000-usb-0:1-video-index0");
  const auto cameras = FindV4l2Cameras(system_, dev_);
  ASSERT_EQ(cameras.size(), 1u);
  EXPECT_EQ(cameras[0].driver, CameraDriver::kV4l2);
  EXPECT_EQ(cameras[0].id, dev_ / "v4l/by-id/usb-Maker_Camera_17-video-index0");
  EXPECT_THAT(cameras[0].other_ids,
              testing::ElementsAre(dev_ / "v4l/by-path/pci-0000-usb-0:1-video-index0", dev_ / "video0"));
}

TEST_F(FindV4l2CamerasIn, TellsDriverBusAndTheFormatsThatAreRead) {
  const auto node = Plug("video3");
  node->formats = {{"NV12", {{8, 4}}}, {"YUYV", {{8, 4}}}, {"MJPG", {{8, 4}}}};
  const auto cameras = FindV4l2Cameras(system_, dev_);
  ASSERT_EQ(cameras.size(), 1u);
  EXPECT_EQ(cameras[0].id, dev_ / "video3");
  EXPECT_EQ(cameras[0].model, "Fake camera");
  EXPECT_EQ(cameras[0].address, "usb-1 (fake)");
  EXPECT_THAT(cameras[0].formats, testing::ElementsAre("YUYV", "MJPG"));
  EXPECT_EQ(cameras[0].note, "");
}

TEST_F(FindV4l2CamerasIn, SkipsNodesThatAreNoCameras) {
  Plug("video0")->caps = V4L2_CAP_META_CAPTURE | V4L2_CAP_STREAMING;
  Plug("video1")->caps = V4L2_CAP_VIDEO_OUTPUT | V4L2_CAP_STREAMING;
  Plug("video2");
  const auto cameras = FindV4l2Cameras(system_, dev_);
  ASSERT_EQ(cameras.size(), 1u);
  EXPECT_EQ(cameras[0].id, dev_ / "video2");
}

TEST_F(FindV4l2CamerasIn, SaysWhyACameraCannotBeOpened) {
  Plug("video0");
  system_.open_fails[dev_ / "video0"] = EACCES;
  const auto cameras = FindV4l2Cameras(system_, dev_);
  ASSERT_EQ(cameras.size(), 1u);
  EXPECT_THAT(cameras[0].note, testing::HasSubstr("group video"));
}

TEST_F(FindV4l2CamerasIn, SaysThatNoFormatIsRead) {
  Plug("video0")->formats = {{"H264", {{8, 4}}}};
  EXPECT_THAT(FindV4l2Cameras(system_, dev_).at(0).note, testing::HasSubstr("no format"));
}

TEST_F(FindV4l2CamerasIn, FindsTheCameraThatAnotherProgramStreamsFrom) {
  Plug("video0")->owner = 1;
  EXPECT_EQ(FindV4l2Cameras(system_, dev_).size(), 1u);
}

TEST_F(FindV4l2CamerasIn, ListsByNumber) {
  Plug("video10");
  Plug("video9");
  Plug("video-of-nobody");
  const auto cameras = FindV4l2Cameras(system_, dev_);
  ASSERT_EQ(cameras.size(), 2u);
  EXPECT_EQ(cameras[0].id, dev_ / "video9");
  EXPECT_EQ(system_.open_fds(), 0u);
}

TEST(FindV4l2Cameras, FindsNoneWithoutAFolder) {
  FakeV4l2 system;
  EXPECT_TRUE(FindV4l2Cameras(system, "/nonexistent").empty());
}

}  // namespace
}  // namespace granary
