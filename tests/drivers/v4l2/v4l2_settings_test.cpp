#include <cerrno>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/camera_v4l2.h"
#include "drivers/errors.h"
#include "drivers/v4l2_controls.h"
#include "drivers/v4l2_node.h"
#include "tests/drivers/v4l2/fake_v4l2.h"

namespace granary {
namespace {

using testing::AllOf;
using testing::HasSubstr;

const std::string kPath = "/dev/video-of-the-test";

struct Bench {
  V4l2Format Set(const CameraOptions& options, cv::Size size = {}) {
    const V4l2Node opened(system, kPath);
    return opened.SetFormat(options, size);
  }
  // What is said when options are refused.
  std::string Refusal(const std::function<void(const V4l2Node&)>& set) {
    const V4l2Node opened(system, kPath);
    try {
      set(opened);
      return "nothing was thrown";
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.reason(), Reason::kSettingRefused) << error.what();
      EXPECT_THAT(error.what(), HasSubstr(kPath));
      return error.what();
    }
  }
  std::string FormatRefusal(const CameraOptions& options, cv::Size size = {}) {
    return Refusal([&](const V4l2Node& opened) { (void)opened.SetFormat(options, size); });
  }
  void SetFeature(const std::string& name, const decltype(Feature::second)& value) {
    const V4l2Node opened(system, kPath);
    SetControls(opened, {{name, value}});
  }
  std::string FeatureRefusal(const std::string& name, const decltype(Feature::second)& value) {
    return Refusal([&](const V4l2Node& opened) { SetControls(opened, {{name, value}}); });
  }
  FakeV4l2 system;
  std::shared_ptr<FakeNode> node = system.Plug(kPath);
};

std::string OpenRefusal(Bench& bench) {
  try {
    const V4l2Node opened(bench.system, kPath);
    return "nothing was thrown";
  } catch (const DeviceError& error) {
    return error.what();
  }
}

Reason OpenReason(Bench& bench) {
  try {
    const V4l2Node opened(bench.system, kPath);
    return Reason::kOk;
  } catch (const DeviceError& error) {
    return error.reason();
  }
}

TEST(V4l2Node, IsUnavailableWhenAbsent) {
  Bench bench;
  bench.node->Unplug();
  EXPECT_EQ(OpenReason(bench), Reason::kCameraUnavailable);
  EXPECT_THAT(OpenRefusal(bench), AllOf(HasSubstr(kPath), HasSubstr("No such file")));
}

TEST(V4l2Node, SaysWhichGroupMayOpenIt) {
  Bench bench;
  bench.system.open_fails[kPath] = EACCES;
  EXPECT_THAT(OpenRefusal(bench), HasSubstr("group video"));
}

TEST(V4l2Node, IsInUseWhenItCannotBeOpenedTwice) {
  Bench bench;
  bench.system.open_fails[kPath] = EBUSY;
  EXPECT_EQ(OpenReason(bench), Reason::kCameraInUse);
}

TEST(V4l2Node, RefusesNodesThatCaptureNoVideo) {
  Bench bench;
  bench.node->caps = V4L2_CAP_META_CAPTURE | V4L2_CAP_STREAMING;
  EXPECT_THAT(OpenRefusal(bench), HasSubstr("id: the node captures no video"));
  EXPECT_EQ(bench.system.open_fds(), 0u);
}

TEST(V4l2Node, RefusesNodesThatCannotStream) {
  Bench bench;
  bench.node->caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_READWRITE;
  EXPECT_THAT(OpenRefusal(bench), HasSubstr("cannot stream"));
}

TEST(SetFormat, TakesTheMostBitsWhenNoneIsAskedFor) {
  Bench bench;
  bench.node->formats = {{"MJPG", {{8, 4}}}, {"NV12", {{8, 4}}}, {"GREY", {{8, 4}}}, {"Y12", {{8, 4}}}};
  EXPECT_EQ(bench.Set({}).layout, PixelLayout::kMono12);
}

TEST(SetFormat, SetsEveryFormatThatIsRead) {
  for (const char* name : {"GREY", "Y10", "Y12", "Y14", "Y16", "Y10P", "YUYV", "MJPG"}) {
    Bench bench;
    bench.node->formats = {{"GREY", {{8, 4}}}, {name, {{8, 4}}}};
    CameraOptions options;
    options.pixel_format = name;
    const V4l2Format format = bench.Set(options);
    EXPECT_EQ(format.name, name);
    EXPECT_EQ(format.layout, LayoutOfV4l2(name));
    EXPECT_EQ(format.row_bytes, RowBytesOf(format.layout, 8));
  }
}

TEST(SetFormat, ListsWhatTheNodeOffersWhenItHasNotTheFormat) {
  Bench bench;
  bench.node->formats = {{"GREY", {{8, 4}, {16, 8}}}, {"YUYV", {{8, 4}}}};
  CameraOptions options;
  options.pixel_format = "Y16";
  EXPECT_THAT(bench.FormatRefusal(options),
              AllOf(HasSubstr("pixel_format: asked for \"Y16\""), HasSubstr("GREY (8x4, 16x8), YUYV (8x4)")));
}

TEST(SetFormat, RefusesFormatsThatThisProgramDoesNotRead) {
  Bench bench;
  CameraOptions options;
  options.pixel_format = "NV12";
  EXPECT_THAT(bench.FormatRefusal(options), HasSubstr("pixel_format: \"NV12\" is none that this program reads"));
}

TEST(SetFormat, SaysSoWhenNoneOfTheNodesFormatsIsRead) {
  Bench bench;
  bench.node->formats = {{"H264", {{8, 4}}}};
  EXPECT_THAT(bench.FormatRefusal({}), AllOf(HasSubstr("pixel_format:"), HasSubstr("H264")));
}

TEST(SetFormat, TakesTheSizeOfTheCalibration) {
  Bench bench;
  EXPECT_EQ(bench.Set({}, {16, 8}).size, cv::Size(16, 8));
}

TEST(SetFormat, RefusesASizeThatTheNodeHasNot) {
  Bench bench;
  EXPECT_THAT(bench.FormatRefusal({}, {640, 480}),
              AllOf(HasSubstr("roi_px: asked for 640x480"), HasSubstr("gives 8x4"), HasSubstr("16x8")));
}

TEST(SetFormat, RefusesHalfPictures) {
  Bench bench;
  bench.node->interlaced = true;
  EXPECT_THAT(bench.FormatRefusal({}), HasSubstr("interlaced"));
}

TEST(SetFormat, CutsOutAPartWhereTheDriverCan) {
  Bench bench;
  bench.node->can_crop = true;
  CameraOptions options;
  options.roi_px = {4, 2, 8, 4};
  EXPECT_EQ(bench.Set(options).size, cv::Size(8, 4));
  EXPECT_EQ(bench.node->crop.left, 4);
  EXPECT_EQ(bench.node->crop.top, 2);
}

TEST(SetFormat, TakesTheWholePictureAgainWithoutAWish) {
  Bench bench;
  bench.node->can_crop = true;
  bench.node->crop = {4, 2, 8, 4};
  (void)bench.Set({});
  EXPECT_EQ(bench.node->crop.left, 0);
  EXPECT_EQ(bench.node->crop.width, 16u);
}

TEST(SetFormat, RefusesAPartWhereTheDriverCannotCut) {
  Bench bench;
  CameraOptions options;
  options.roi_px = {4, 2, 8, 4};
  EXPECT_THAT(bench.FormatRefusal(options), HasSubstr("roi_px: the driver cannot cut out"));
}

TEST(SetFormat, RefusesAPartThatTheDriverMoves) {
  Bench bench;
  bench.node->can_crop = true;
  CameraOptions options;
  options.roi_px = {3, 2, 8, 4};
  EXPECT_THAT(bench.FormatRefusal(options), HasSubstr("roi_px: the driver makes of it [2, 2, 8, 4]"));
}

FakeControl Number(const std::string& name, std::int64_t low, std::int64_t high, std::int64_t value,
                   std::int64_t step = 1) {
  return {name, V4L2_CTRL_TYPE_INTEGER, low, high, step, value};
}

TEST(SwitchAutomaticsOff, SwitchesOffWhatTheNodeHas) {
  Bench bench;
  auto& controls = bench.node->controls;
  controls[V4L2_CID_EXPOSURE_AUTO] = {
      "Auto Exposure", V4L2_CTRL_TYPE_MENU, 0, 3, 1, 3, 0, {{1, "Manual"}, {3, "Auto"}}};
  controls[V4L2_CID_AUTO_WHITE_BALANCE] = {"White Balance, Automatic", V4L2_CTRL_TYPE_BOOLEAN, 0, 1, 1, 1};
  controls[V4L2_CID_AUTOGAIN] = {"Gain, Automatic", V4L2_CTRL_TYPE_BOOLEAN, 0, 1, 1, 1};
  controls[V4L2_CID_FOCUS_AUTO] = {"Focus, Automatic", V4L2_CTRL_TYPE_BOOLEAN, 0, 1, 1, 1};
  SwitchAutomaticsOff(V4l2Node(bench.system, kPath));
  EXPECT_EQ(controls[V4L2_CID_EXPOSURE_AUTO].value, V4L2_EXPOSURE_MANUAL);
  EXPECT_EQ(controls[V4L2_CID_AUTO_WHITE_BALANCE].value, 0);
  EXPECT_EQ(controls[V4L2_CID_AUTOGAIN].value, 0);
  EXPECT_EQ(controls[V4L2_CID_FOCUS_AUTO].value, 0);
}

TEST(SwitchAutomaticsOff, RefusesANodeThatStaysAutomatic) {
  Bench bench;
  bench.node->controls[V4L2_CID_AUTOGAIN] = {"Gain, Automatic", V4L2_CTRL_TYPE_BOOLEAN, 0, 1, 1, 1};
  bench.node->controls[V4L2_CID_AUTOGAIN].stuck = true;
  EXPECT_THAT(bench.Refusal(SwitchAutomaticsOff), HasSubstr("gain_automatic: set to 0, reads back 1"));
}

TEST(SetExposureTime, CountsInUnitsOf100Microseconds) {
  Bench bench;
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = Number("Exposure Time, Absolute", 1, 5000, 157);
  const V4l2Node node(bench.system, kPath);
  EXPECT_TRUE(SetExposureTime(node, 8000));
  EXPECT_EQ(bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE].value, 80);
  EXPECT_EQ(ExposureTime(node), std::chrono::milliseconds(8));
}

TEST(SetExposureTime, RefusesWhatIsBetweenTheSteps) {
  Bench bench;
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = Number("Exposure Time, Absolute", 1, 5000, 157);
  EXPECT_THAT(bench.Refusal([](const V4l2Node& node) { SetExposureTime(node, 1250); }),
              AllOf(HasSubstr("exposure_us: 1250"), HasSubstr("100 to 500000 in steps of 100")));
}

TEST(SetExposureTime, RefusesWhatIsBeyondTheRange) {
  Bench bench;
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = Number("Exposure Time, Absolute", 1, 50, 1);
  EXPECT_THAT(bench.Refusal([](const V4l2Node& node) { SetExposureTime(node, 8000); }), HasSubstr("100 to 5000"));
}

TEST(SetExposureTime, RefusesAnExposureThatDoesNotStay) {
  Bench bench;
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = Number("Exposure Time, Absolute", 1, 5000, 157);
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE].stuck = true;
  EXPECT_THAT(bench.Refusal([](const V4l2Node& node) { SetExposureTime(node, 8000); }),
              HasSubstr("exposure_us (in units of 100 us): set to 80, reads back 157"));
}

TEST(SetExposureTime, LeavesAControlWithoutUnitAlone) {
  Bench bench;
  bench.node->controls[V4L2_CID_EXPOSURE] = Number("Exposure", 0, 1000, 5);
  EXPECT_FALSE(SetExposureTime(V4l2Node(bench.system, kPath), 8000));
  EXPECT_EQ(bench.node->controls[V4L2_CID_EXPOSURE].value, 5);
}

TEST(ExposureTime, IsUnknownWhileTheCameraChoosesItself) {
  Bench bench;
  bench.node->controls[V4L2_CID_EXPOSURE_ABSOLUTE] = Number("Exposure Time, Absolute", 1, 5000, 157);
  bench.node->controls[V4L2_CID_EXPOSURE_AUTO] = {"Auto Exposure", V4L2_CTRL_TYPE_MENU, 0, 3, 1, 3};
  EXPECT_EQ(ExposureTime(V4l2Node(bench.system, kPath)), std::nullopt);
}

TEST(SetGain, SetsTheLeastGain) {
  Bench bench;
  bench.node->controls[V4L2_CID_GAIN] = Number("Gain", 16, 255, 100);
  SetGain(V4l2Node(bench.system, kPath), 0);
  EXPECT_EQ(bench.node->controls[V4L2_CID_GAIN].value, 16);
}

TEST(SetGain, RefusesDecibels) {
  Bench bench;
  bench.node->controls[V4L2_CID_GAIN] = Number("Gain", 16, 255, 100);
  EXPECT_THAT(bench.Refusal([](const V4l2Node& node) { SetGain(node, 6); }),
              AllOf(HasSubstr("gain_db: must be 0"), HasSubstr("features = { gain = "), HasSubstr("16 to 255")));
}

TEST(SetControls, FindsControlsByBothOfTheirNames) {
  Bench bench;
  bench.node->controls[V4L2_CID_GAMMA] = Number("Gamma, (Tone)", 0, 500, 100);
  bench.SetFeature("gamma_tone", std::int64_t{120});
  EXPECT_EQ(bench.node->controls[V4L2_CID_GAMMA].value, 120);
  bench.SetFeature("Gamma, (Tone)", std::int64_t{130});
  EXPECT_EQ(bench.node->controls[V4L2_CID_GAMMA].value, 130);
}

TEST(SetControls, SetsControlsOfEveryKind) {
  Bench bench;
  auto& controls = bench.node->controls;
  controls[V4L2_CID_BRIGHTNESS] = Number("Brightness", -64, 64, 0);
  controls[V4L2_CID_HFLIP] = {"Horizontal Flip", V4L2_CTRL_TYPE_BOOLEAN, 0, 1, 1, 0};
  controls[V4L2_CID_POWER_LINE_FREQUENCY] = {
      "Power Line Frequency", V4L2_CTRL_TYPE_MENU, 0, 2, 1, 0, 0, {{0, "Disabled"}, {1, "50 Hz"}, {2, "60 Hz"}}};
  controls[0x00f00001] = {"Clock", V4L2_CTRL_TYPE_INTEGER64, 0, std::int64_t{1} << 40, 1, 0};
  controls[0x00f00002] = {"Mask", V4L2_CTRL_TYPE_BITMASK, 0, 0xFFFF0000, 0, 0};
  controls[0x00f00003] = {"Label", V4L2_CTRL_TYPE_STRING, 0, 8, 1, 0};
  controls[0x00f00004] = {"Restart", V4L2_CTRL_TYPE_BUTTON, 0, 0, 0, 0};
  controls[0x00f00005] = {"Speed", V4L2_CTRL_TYPE_INTEGER_MENU, 0, 1, 1, 0, 0, {{0, "100"}, {1, "400"}}};
  bench.SetFeature("brightness", std::int64_t{-3});
  bench.SetFeature("horizontal_flip", true);
  bench.SetFeature("power_line_frequency", std::string("50 Hz"));
  bench.SetFeature("clock", std::int64_t{1} << 39);
  bench.SetFeature("mask", std::int64_t{0x80010000});
  bench.SetFeature("label", std::string("left"));
  bench.SetFeature("restart", true);
  bench.SetFeature("speed", std::string("400"));
  EXPECT_EQ(controls[V4L2_CID_BRIGHTNESS].value, -3);
  EXPECT_EQ(controls[V4L2_CID_HFLIP].value, 1);
  EXPECT_EQ(controls[V4L2_CID_POWER_LINE_FREQUENCY].value, 1);
  EXPECT_EQ(controls[0x00f00001].value, std::int64_t{1} << 39);
  EXPECT_EQ(static_cast<std::uint32_t>(controls[0x00f00002].value), 0x80010000u);
  EXPECT_EQ(controls[0x00f00003].text, "left");
  EXPECT_EQ(controls[0x00f00005].value, 1);
}

TEST(SetControls, RefusesValuesThatTheControlDoesNotAllow) {
  Bench bench;
  auto& controls = bench.node->controls;
  controls[V4L2_CID_SHARPNESS] = Number("Sharpness", 0, 64, 0, 8);
  controls[V4L2_CID_POWER_LINE_FREQUENCY] = {"Power Line Frequency",         V4L2_CTRL_TYPE_MENU, 0, 2, 1, 0, 0,
                                             {{0, "Disabled"}, {2, "60 Hz"}}};
  EXPECT_THAT(bench.FeatureRefusal("sharpness", std::int64_t{65}),
              AllOf(HasSubstr("features.sharpness: 65 is refused"), HasSubstr("0 to 64 in steps of 8")));
  EXPECT_THAT(bench.FeatureRefusal("sharpness", std::int64_t{9}), HasSubstr("in steps of 8"));
  EXPECT_THAT(bench.FeatureRefusal("sharpness", 8.5), HasSubstr("must be a whole number"));
  EXPECT_THAT(bench.FeatureRefusal("sharpness", true), HasSubstr("must be a whole number"));
  EXPECT_THAT(bench.FeatureRefusal("power_line_frequency", std::int64_t{1}),
              HasSubstr("one of 0 (\"Disabled\"), 2 (\"60 Hz\")"));
  EXPECT_THAT(bench.FeatureRefusal("power_line_frequency", std::string("50 Hz")), HasSubstr("\"50 Hz\" is refused"));
}

TEST(SetControls, ListsTheControlsWhenThereIsNoneOfTheName) {
  Bench bench;
  bench.node->controls[V4L2_CID_GAIN] = Number("Gain", 16, 255, 100);
  EXPECT_THAT(bench.FeatureRefusal("gian", std::int64_t{20}),
              AllOf(HasSubstr("features.gian: the node has no such control"), HasSubstr("it has gain")));
}

TEST(SetControls, RefusesControlsThatCanOnlyBeRead) {
  Bench bench;
  bench.node->controls[V4L2_CID_GAIN] = Number("Gain", 16, 255, 100);
  bench.node->controls[V4L2_CID_GAIN].flags = V4L2_CTRL_FLAG_READ_ONLY;
  EXPECT_THAT(bench.FeatureRefusal("gain", std::int64_t{20}), HasSubstr("features.gain: the control can only be read"));
}

TEST(SetControls, ReadsBackWhatItSet) {
  Bench bench;
  bench.node->controls[V4L2_CID_GAIN] = Number("Gain", 16, 255, 100);
  bench.node->controls[V4L2_CID_GAIN].stuck = true;
  EXPECT_THAT(bench.FeatureRefusal("gain", std::int64_t{20}), HasSubstr("features.gain: set to 20, reads back 100"));
}

TEST(CameraV4l2, SetsFeaturesAfterAllElse) {
  Bench bench;
  bench.node->controls[V4L2_CID_GAIN] = Number("Gain", 0, 255, 100);
  CameraOptions options;
  options.id = kPath;
  options.features = {{"gain", std::int64_t{20}}};
  const CameraV4l2 camera(options, TriggerMode::kLine0, {}, bench.system);
  EXPECT_EQ(bench.node->controls[V4L2_CID_GAIN].value, 20);
}

}  // namespace
}  // namespace granary
