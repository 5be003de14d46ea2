// The Aravis driver against cameras that speak GigE Vision over real sockets: what it hands out, and what the daemon
// makes of every fault.
#include <gtest/gtest.h>

#include <cmath>
#include <csignal>
#include <cstdint>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "daemon/record_json.h"
#include "daemon/store.h"
#include "drivers/errors.h"
#include "drivers/rig.h"
#include "drivers/sim/scene.h"
#include "pipeline/calibration_file.h"
#include "pipeline/frame_file.h"
#include "tests/daemon/ctl/run_program.h"
#include "tests/loopback/daemon_process.h"
#include "tests/loopback/half_size_rig.h"
#include "tests/loopback/network_namespace.h"
#include "tests/loopback/sim_gige_process.h"

namespace granary {
namespace {

constexpr int kStatusWord = 0, kReason = 2, kSequence = 5, kVolume = 10;
constexpr int kValid = 1 << 0, kHeld = 1 << 1, kSimulated = 1 << 4;

bool Same(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0;
}

/// One bin under two GigE cameras with small pictures, and the same bin simulated in the process.
class Gige : public testing::Test {
 protected:
  void SetUp() override {
    if (const auto why_not = EnterNetworkNamespace(); !why_not.empty()) GTEST_SKIP() << why_not;
    WriteHalfSizeRig(folder_.path());
    Configure("gige.toml", R"(driver = "aravis", id = "Aravis-SIM-left")",
              R"(driver = "aravis", id = "Aravis-SIM-right")", "none");
    Configure("sim.toml", R"(driver = "sim")", R"(driver = "sim")", "sim");
  }

  void Configure(const std::string& file, const std::string& left, const std::string& right,
                 const std::string& projector, const std::string& rig = "") const {
    std::ofstream(folder_ / file) << "[modbus.tcp]\nlisten = \"127.0.0.1:" << kPort << "\"\n"
                                  << "[[bin]]\nid = 1\nname = \"bay-1\"\n"
                                  << "footprint_m = [[0, 0], [0.52, 0], [0.52, 0.355], [0, 0.355]]\n"
                                  << "height_m = 0.285\nschedule = { every = \"1s\" }\n"
                                  << "[bin.inventory]\nbook_mass_kg = 15.25\ndensity_kg_m3 = 790.0\n"
                                  << "[bin.cycle]\nattempts = 1\n"
                                  // The simulator's speckle is too fine for small pictures; accuracy is no matter here.
                                  << "[bin.surface]\nmin_coverage = 0.2\n"
                                  << "[[bin.rig]]\nname = \"a\"\ncalibration = \"stereo.yml\"\npose = \"world.yml\"\n"
                                  << rig << "left = { " << left << " }\nright = { " << right << " }\n"
                                  << "projector = { driver = \"" << projector << "\" }\n"
                                  << "[bin.rig.sim]\nvolume_m3 = 0.019\n";
  }

  [[nodiscard]] std::vector<std::string> Cameras(std::vector<std::string> more = {}) const {
    more.insert(more.begin(), {"-c", (folder_ / "gige.toml").string()});
    return more;
  }
  [[nodiscard]] RigWorld World() const {
    RigWorld world;
    world.bin.footprint_m = {{0, 0}, {0.52, 0}, {0.52, 0.355}, {0, 0.355}};
    world.bin.height_m = 0.285;
    world.calibration = LoadStereoCalibration(folder_ / "stereo.yml");
    world.world_from_left = LoadWorldFromLeft(folder_ / "world.yml");
    return world;
  }
  [[nodiscard]] static RigOptions Options() {
    RigOptions options;
    options.left.driver = options.right.driver = CameraDriver::kAravis;
    options.left.id = "Aravis-SIM-left";
    options.right.id = "Aravis-SIM-right";
    options.sim.volume_m3 = 0.019;
    return options;
  }

  static constexpr std::uint16_t kPort = 1502;  // ours alone, in our own network
  CtlFolder folder_;
};

TEST_F(Gige, HandsOutTheVeryPixelsOfTheScene) {
  const SimGigeProcess cameras(Cameras());
  Rig rig = OpenRig(Options(), World());
  SimScene scene(Options().sim, World());
  for (int i = 0; i < 3; ++i) {
    const FramePair pair = rig.CapturePair();
    EXPECT_EQ(pair.left.frame_id, pair.right.frame_id);
    EXPECT_TRUE(Same(pair.left.image, scene.RenderSide(Side::kLeft, pair.left.frame_id, true, {}).image));
    EXPECT_TRUE(Same(pair.right.image, scene.RenderSide(Side::kRight, pair.right.frame_id, true, {}).image));
    EXPECT_TRUE(pair.left.simulated && pair.right.simulated);
  }
}

TEST_F(Gige, TakesExposureGainAndRegionFromTheClient) {
  const SimGigeProcess cameras(Cameras());
  RigOptions options = Options();
  for (auto* camera : {&options.left, &options.right}) {
    camera->exposure_us = 5000;
    camera->features = {{"GainRaw", std::int64_t{4}}};
    camera->roi_px = {64, 32, 320, 256};
  }
  Rig rig = OpenRig(options, World());
  SimScene scene(options.sim, World());
  const FramePair pair = rig.CapturePair();
  const cv::Mat all = scene.RenderSide(Side::kRight, pair.right.frame_id, true, {5000, 4}).image;
  EXPECT_TRUE(Same(pair.right.image, all(cv::Rect(64, 32, 320, 256))));
}

TEST_F(Gige, SendsSixteenBitsToo) {
  const SimGigeProcess cameras(Cameras());
  RigOptions options = Options();
  options.left.pixel_format = options.right.pixel_format = "Mono16";
  Rig rig = OpenRig(options, World());
  SimScene scene(options.sim, World());
  const FramePair pair = rig.CapturePair();
  cv::Mat wanted;
  scene.RenderSide(Side::kLeft, pair.left.frame_id, true, {}).image.convertTo(wanted, CV_16U, 257);
  EXPECT_EQ(pair.left.bit_depth, 16);
  EXPECT_TRUE(Same(pair.left.image, wanted));
}

TEST_F(Gige, HandsOutNoBrokenPairWhenPacketsAreLost) {
  const SimGigeProcess cameras(Cameras({"--lost-percent", "1"}));
  RigOptions options = Options();
  // 23 packets a frame: of ten pairs about six come whole.
  options.left.packet_size = options.right.packet_size = 16000;
  options.warmup_pairs = 0;
  SimScene scene(options.sim, World());
  int whole = 0, refused = 0;
  std::optional<Rig> rig;
  while (whole < 10 || refused < 3) {
    ASSERT_LT(whole + refused, 200) << whole << " whole, " << refused << " refused";
    try {
      if (!rig) rig.emplace(OpenRig(options, World()));
      const FramePair pair = rig->CapturePair();
      ++whole;
      EXPECT_EQ(pair.left.frame_id, pair.right.frame_id);
      EXPECT_TRUE(Same(pair.left.image, scene.RenderSide(Side::kLeft, pair.left.frame_id, true, {}).image));
      EXPECT_TRUE(Same(pair.right.image, scene.RenderSide(Side::kRight, pair.right.frame_id, true, {}).image));
    } catch (const DeviceError& error) {
      ++refused;
      EXPECT_TRUE(error.reason() == Reason::kFrameMissing || error.reason() == Reason::kFrameInvalid) << error.what();
      rig.reset();  // as the daemon does
    }
  }
  RecordProperty("whole", whole);
  RecordProperty("refused", refused);
}

TEST_F(Gige, MeasuresTheVolumeThatTheSimulatorInTheProcessMeasures) {
  {
    const SimGigeProcess empty(Cameras({"--empty"}));
    const auto reference = folder_.Run("-c gige.toml reference");
    ASSERT_EQ(reference.exit_code, 0) << reference.err;
  }
  Configure("gige.toml", R"(driver = "aravis", id = "Aravis-SIM-left")",
            R"(driver = "aravis", id = "Aravis-SIM-right")", "none", "warmup_pairs = 0\n");  // both take shot 1
  const SimGigeProcess cameras(Cameras());
  const auto over_gige = folder_.Run("-c gige.toml measure --json");
  ASSERT_EQ(over_gige.exit_code, 0) << over_gige.err;
  const auto in_process = folder_.Run("-c sim.toml measure --json");
  ASSERT_EQ(in_process.exit_code, 0) << in_process.err;
  for (const char* key : {"volume_m3", "volume_u95_m3", "coverage_percent", "points", "simulated"}) {
    EXPECT_EQ(over_gige.Document()[key], in_process.Document()[key]) << key;
  }
  EXPECT_EQ(over_gige.Document()["simulated"], true);
}

TEST_F(Gige, SnapshotSavesTheVeryPixels) {
  const SimGigeProcess cameras(Cameras());
  const auto snapshot = folder_.Run("-c gige.toml snapshot -o pair");
  ASSERT_EQ(snapshot.exit_code, 0) << snapshot.err;
  SimScene scene(Options().sim, World());
  const FramePair saved = LoadFramePair(folder_ / "pair/left.png", folder_ / "pair/right.png");
  constexpr std::uint64_t kShot = 2;  // the first one warms up
  EXPECT_TRUE(Same(saved.left.image, scene.RenderSide(Side::kLeft, kShot, true, {}).image));
  EXPECT_TRUE(Same(saved.right.image, scene.RenderSide(Side::kRight, kShot, true, {}).image));
}

/// The daemon over GigE, measuring every second.
class GigeDaemon : public Gige {
 protected:
  [[nodiscard]] std::vector<std::string> Arguments() const { return {"--config", (folder_ / "gige.toml").string()}; }
  [[nodiscard]] static std::optional<double> Read(int address, const std::string& type = "4") {
    return ReadModbus(kPort, address, type);
  }
  [[nodiscard]] static bool HasBit(int bit) { return (static_cast<int>(Read(kStatusWord).value_or(0)) & bit) != 0; }
  [[nodiscard]] static bool Measures() { return HasBit(kValid) && Read(kReason) == 0.0; }

  /// The fault shows as `reason`, and the last good figure is held: same number, same sequence.
  void ExpectHeld(DaemonProcess& daemon, Reason reason) const {
    ASSERT_TRUE(Eventually([&] { return Read(kReason) == static_cast<double>(reason); }))
        << "reason " << Read(kReason).value_or(NAN) << "\n"
        << daemon.Stdout();
    EXPECT_TRUE(HasBit(kHeld));
    EXPECT_FALSE(HasBit(kValid));
    const auto good = Store(folder_ / "state", Store::Access::kRead).LastGood(1);
    ASSERT_TRUE(good);
    EXPECT_EQ(Read(kSequence), static_cast<double>(good->sequence));
    EXPECT_NEAR(Read(kVolume, "4:float").value_or(NAN), *good->volume_m3, 5.1e-6 * *good->volume_m3);
    EXPECT_NE(daemon.Stdout().find(InfoOf(reason).name), std::string::npos) << daemon.Stdout();
  }
  static void ExpectMeasuresAgain(DaemonProcess& daemon) {
    const double before = Read(kSequence).value_or(-1);
    EXPECT_TRUE(Eventually([&] { return Measures() && Read(kSequence).value_or(-1) > before; })) << daemon.Stdout();
    EXPECT_TRUE(daemon.Running());
  }
  static void ExpectMeasures(DaemonProcess& daemon) {
    ASSERT_TRUE(Eventually([&] { return Measures(); })) << daemon.Stdout() << daemon.Stderr();
  }

  void SetUp() override {
    Gige::SetUp();
    if (IsSkipped()) return;
    if (!HasMbpoll()) GTEST_SKIP() << "mbpoll is not installed";
  }
};

TEST_F(GigeDaemon, SaysThatItsFiguresAreSimulated) {
  const SimGigeProcess cameras(Cameras());
  DaemonProcess daemon(folder_.path(), Arguments());
  ExpectMeasures(daemon);
  EXPECT_TRUE(HasBit(kSimulated));
  EXPECT_TRUE(Store(folder_ / "state", Store::Access::kRead).LastGood(1)->simulated);
}

TEST_F(GigeDaemon, WaitsForCamerasThatAreAbsentAtItsStart) {
  DaemonProcess daemon(folder_.path(), Arguments());
  ASSERT_TRUE(Eventually([&] { return Read(kReason) == static_cast<double>(Reason::kCameraUnavailable); }))
      << daemon.Stdout() << daemon.Stderr();
  EXPECT_FALSE(HasBit(kValid));
  EXPECT_NE(daemon.Stdout().find("Aravis-SIM-left"), std::string::npos) << daemon.Stdout();
  const SimGigeProcess cameras(Cameras());
  ExpectMeasuresAgain(daemon);
}

TEST_F(GigeDaemon, HoldsWhileTheCamerasAreGone) {
  auto cameras = std::make_unique<SimGigeProcess>(Cameras());
  DaemonProcess daemon(folder_.path(), Arguments());
  ExpectMeasures(daemon);
  cameras->End(SIGKILL);
  ExpectHeld(daemon, Reason::kCameraUnavailable);
  cameras = std::make_unique<SimGigeProcess>(Cameras());
  ExpectMeasuresAgain(daemon);
}

TEST_F(GigeDaemon, HoldsWhileOneCameraIsPulled) {
  SimGigeProcess cameras(Cameras());
  DaemonProcess daemon(folder_.path(), Arguments());
  ExpectMeasures(daemon);
  cameras.Tell("pull right");
  ExpectHeld(daemon, Reason::kCameraUnavailable);
  EXPECT_NE(daemon.Stdout().find("Aravis-SIM-right"), std::string::npos) << daemon.Stdout();
  cameras.Tell("plug right");
  ExpectMeasuresAgain(daemon);
}

TEST_F(GigeDaemon, HoldsWhileOneCameraIsSilent) {
  SimGigeProcess cameras(Cameras());
  DaemonProcess daemon(folder_.path(), Arguments());
  ExpectMeasures(daemon);
  cameras.Tell("lose right 100");
  ExpectHeld(daemon, Reason::kFrameMissing);
  EXPECT_NE(daemon.Stdout().find("Aravis-SIM-right"), std::string::npos) << daemon.Stdout();
  cameras.Tell("lose right 0");
  ExpectMeasuresAgain(daemon);
}

TEST_F(GigeDaemon, HoldsWhileTheLampIsDead) {
  SimGigeProcess cameras(Cameras());
  DaemonProcess daemon(folder_.path(), Arguments());
  ExpectMeasures(daemon);
  cameras.Tell("lamp off");
  ExpectHeld(daemon, Reason::kProjectorDark);
  cameras.Tell("lamp on");
  ExpectMeasuresAgain(daemon);
}

TEST_F(GigeDaemon, MeasuresOnWhenPacketsAreLost) {
  // 22 packets a frame, lost one in a hundred: each pair comes whole more often than not.
  Configure("gige.toml", R"(driver = "aravis", id = "Aravis-SIM-left", packet_size = 16000)",
            R"(driver = "aravis", id = "Aravis-SIM-right", packet_size = 16000)", "none");
  SimGigeProcess cameras(Cameras());
  DaemonProcess daemon(folder_.path(), Arguments());
  ExpectMeasures(daemon);
  cameras.Tell("lose left 1");
  cameras.Tell("lose right 1");
  for (int i = 0; i < 3; ++i) ExpectMeasuresAgain(daemon);
}

using SimGigeProgram = Gige;

TEST_F(SimGigeProgram, EndsWithZeroOnSigterm) {
  SimGigeProcess cameras(Cameras());
  EXPECT_EQ(cameras.End(SIGTERM), 0);
}

TEST_F(SimGigeProgram, NamesTheAddressThatIsTaken) {
  const SimGigeProcess first(Cameras());
  SimGigeProcess second(Cameras());
  EXPECT_EQ(second.ExitCode(), 1);
  EXPECT_NE(second.Output().find("127.0.0.1 port 3956: in use"), std::string::npos) << second.Output();
}

TEST_F(SimGigeProgram, NamesTheAddressThatIsNotHere) {
  for (const std::string address : {"127.0.0.3", "192.0.2.7"}) {
    SimGigeProcess cameras(Cameras({"--right", address}));
    EXPECT_EQ(cameras.ExitCode(), 1);
    EXPECT_NE(cameras.Output().find(address + ": no network interface has this address"), std::string::npos)
        << cameras.Output();
  }
}

TEST_F(SimGigeProgram, RefusesPicturesThatAreTooLarge) {
  StereoCalibration calibration = LoadStereoCalibration(folder_ / "stereo.yml");
  calibration.image_size = {2448, 2048};
  SaveStereoCalibration(folder_ / "stereo.yml", calibration);
  SimGigeProcess cameras(Cameras());
  EXPECT_EQ(cameras.ExitCode(), 1);
  EXPECT_NE(cameras.Output().find((folder_ / "stereo.yml").string()), std::string::npos) << cameras.Output();
  EXPECT_NE(cameras.Output().find("2448 x 2048"), std::string::npos) << cameras.Output();
}

TEST_F(SimGigeProgram, SaysWhatItDoesNotUnderstand) {
  SimGigeProcess cameras(Cameras());
  for (const std::string line : {"pull middle", "lose left 101", "lose left 1x", "lamp", "pull left now"}) {
    cameras.Tell(line);
    EXPECT_NE(cameras.Output().find("'" + line + "' is no command"), std::string::npos) << cameras.Output();
  }
}

TEST_F(SimGigeProgram, CallsBadUsageTwo) {
  SimGigeProcess cameras(Cameras({"--lost-percent", "200"}));
  EXPECT_EQ(cameras.ExitCode(), 2);
}

}  // namespace
}  // namespace granary
