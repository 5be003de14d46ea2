// Good configurations: what is read is what stands there, and what is printed reads back.
#include "config/config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "tests/config/sample.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using testing::Changed;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::kSample;

std::string ReadText(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  EXPECT_TRUE(stream) << file;
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

Config Sample() { return ParseConfig(kSample, "/etc/granaryd/granaryd.toml"); }

TEST(ParseConfig, AcceptsTheContractsExample) { EXPECT_EQ(testing::Texts(testing::FaultsOf(kSample)), ""); }

TEST(ParseConfig, ReadsModbus) {
  const Config config = Sample();
  EXPECT_EQ(config.modbus.tcp.host, "0.0.0.0");
  EXPECT_EQ(config.modbus.tcp.port, 502);
  EXPECT_THAT(config.modbus.tcp.allow, ElementsAre("192.168.7.0/24"));
  ASSERT_TRUE(config.modbus.rtu);
  EXPECT_EQ(config.modbus.rtu->device, "/dev/ttyS1");
  ASSERT_TRUE(config.modbus.plc);
  EXPECT_EQ(config.modbus.plc->address, "192.168.7.20:502");
}

TEST(ParseConfig, ReadsTheBin) {
  const BinConfig bin = Sample().bins.at(0);
  EXPECT_EQ(bin.bin.id, 1);
  EXPECT_EQ(bin.bin.name, "bay-1");
  EXPECT_THAT(bin.bin.footprint_m, ElementsAre(Eigen::Vector2d(0, 0), Eigen::Vector2d(0.52, 0),
                                               Eigen::Vector2d(0.52, 0.355), Eigen::Vector2d(0, 0.355)));
  EXPECT_EQ(bin.bin.height_m, 0.285);
  EXPECT_EQ(bin.schedule.every, 30min);
  EXPECT_TRUE(bin.schedule.at.empty());
  EXPECT_EQ(bin.inventory.book_mass_kg, 15200.0);
}

TEST(ParseConfig, ReadsTheRig) {
  const RigOptions rig = Sample().bins.at(0).rigs.at(0);
  EXPECT_EQ(rig.max_skew, 500us);
  EXPECT_EQ(rig.left.driver, CameraDriver::kAravis);
  EXPECT_EQ(rig.left.id, "Vendor-Serial");
  EXPECT_EQ(rig.right.driver, CameraDriver::kV4l2);
  EXPECT_EQ(rig.projector.driver, ProjectorDriver::kGpio);
  EXPECT_EQ(rig.projector.line, 17);
  EXPECT_EQ(rig.projector.settle, 200us);
  EXPECT_EQ(rig.projector.max_on, 50ms);
  EXPECT_FALSE(rig.left.trigger.has_value());
}

TEST(ParseConfig, AnchorsPathsAtTheFilesFolder) {
  EXPECT_EQ(Sample().bins.at(0).rigs.at(0).calibration, "/etc/granaryd/stereo.yml");
}

TEST(ParseConfig, KeepsAbsolutePaths) {
  const Config config = ParseConfig(Changed("\"world.yml\"", "\"/srv/world.yml\""), "/etc/granaryd/granaryd.toml");
  EXPECT_EQ(config.bins.at(0).rigs.at(0).pose, "/srv/world.yml");
}

TEST(ParseConfig, SortsTheTimesOfTheDay) {
  const auto text = Changed("{ every = \"30min\" }", "{ at = [\"18:00\", \"06:00\"], timezone = \"Asia/Shanghai\" }");
  const ScheduleOptions schedule = ParseConfig(text, "bay.toml").bins.at(0).schedule;
  EXPECT_THAT(schedule.at, ElementsAre(360min, 1080min));
  EXPECT_EQ(schedule.timezone, "Asia/Shanghai");
}

TEST(ParseConfig, LeavesUnknownBookDataEmpty) {
  const auto text = Changed("book_mass_kg = 15200.0\ndensity_kg_m3 = 790.0\n", "");
  const Inventory inventory = ParseConfig(text, "bay.toml").bins.at(0).inventory;
  EXPECT_FALSE(inventory.book_mass_kg.has_value());
  EXPECT_FALSE(inventory.density_kg_m3.has_value());
}

TEST(ParseConfig, TakesAnInlineTableAsATableOfItsOwnToo) {
  const auto text =
      Changed("right = { driver = \"v4l2\", id = \"/dev/v4l/by-path/…\" }",
              "[bin.rig.right]\ndriver = \"v4l2\"\nid = \"x\"\n[bin.rig.projector]\ndriver = \"none\"\n#");
  const auto at = text.find("projector = { driver = \"gpio\"");
  const RigOptions rig = ParseConfig(text.substr(0, at), "bay.toml").bins.at(0).rigs.at(0);
  EXPECT_EQ(rig.right.id, "x");
}

TEST(ParseConfig, KeepsFeaturesInTheOrderOfTheFileAndPrintsThemSo) {
  const auto text =
      Changed("gain_db = 0 }", "gain_db = 0, features = { Zoom = 2, Auto = false, Level = 1.5, Mode = \"On\" } }");
  const std::vector<Feature> wanted{
      {"Zoom", std::int64_t{2}}, {"Auto", false}, {"Level", 1.5}, {"Mode", std::string("On")}};
  const Config config = ParseConfig(text, "/etc/granaryd/granaryd.toml");
  EXPECT_EQ(config.bins.at(0).rigs.at(0).left.features, wanted);
  const Config again = ParseConfig(PrintConfig(config), "/etc/granaryd/granaryd.toml");
  EXPECT_EQ(again.bins.at(0).rigs.at(0).left.features, wanted);
}

TEST(ParseConfig, TakesFeaturesUnderAHeaderToo) {
  const std::string extra = "[bin.rig.left.features]\nZoom = 2\nAuto = true\n";
  const auto text =
      Changed("left  = { driver = \"aravis\", id = \"Vendor-Serial\", exposure_us = 8000, gain_db = 0 }\n", "");
  const Config config = ParseConfig(text + "[bin.rig.left]\ndriver = \"aravis\"\nid = \"x\"\n" + extra, "bay.toml");
  const std::vector<Feature> wanted{{"Zoom", std::int64_t{2}}, {"Auto", true}};
  EXPECT_EQ(config.bins.at(0).rigs.at(0).left.features, wanted);
}

TEST(ParseConfig, ReadsTheExtraTables) {
  const std::string extra = R"(
[bin.cycle]
attempts = 5
retry_delay = "10s"
max_rate_m3_h = 40
stale_after = "90min"
[bin.stereo]
p1 = 7
[bin.surface]
edge_threshold_m = 0.0042
[bin.quality]
min_speckle_contrast = 0.2
[bin.rig.sim]
shape = "tilted_left"
motion = "cycle"
volume_step_m3 = 0.001
seed = 9
)";
  const BinConfig bin = ParseConfig(kSample + extra, "bay.toml").bins.at(0);
  EXPECT_EQ(bin.cycle.attempts, 5);
  EXPECT_EQ(bin.cycle.retry_delay, 10s);
  EXPECT_EQ(bin.cycle.max_rate_m3_h, 40.0);
  EXPECT_EQ(bin.cycle.stale_after, 90min);
  EXPECT_EQ(bin.pipeline.stereo.p1, 7);
  EXPECT_EQ(bin.pipeline.surface.edge_threshold_m, 0.0042);
  EXPECT_EQ(bin.pipeline.quality.min_speckle_contrast, 0.2);
  EXPECT_EQ(bin.rigs.at(0).sim.shape, SimShape::kTiltedLeft);
  EXPECT_EQ(bin.rigs.at(0).sim.motion, SimMotion::kCycle);
  EXPECT_EQ(bin.rigs.at(0).sim.seed, 9U);
}

TEST(PrintConfig, ReadsBackToTheSame) {
  const auto text = Changed("exclude_m = []", "exclude_m = [[[0.1,0.1],[0.2,0.1],[0.2,0.2]]]") +
                    "[bin.rig.sim]\nvolume_m3 = 0.0193\n";
  const std::string once = PrintConfig(ParseConfig(text, "/etc/granaryd/granaryd.toml"));
  EXPECT_EQ(PrintConfig(ParseConfig(once, "/etc/granaryd/granaryd.toml")), once);
}

TEST(PrintConfig, PrintsEveryKeyThatHasAValue) {
  const std::string printed = PrintConfig(Sample());
  for (const char* line : {"listen = \"0.0.0.0:502\"", "max_clients = 32", "level = \"warn\"", "[[bin.rig]]",
                           "book_mass_kg = 15200.0", "calibration = \"/etc/granaryd/stereo.yml\"",
                           "footprint_m = [[0.0, 0.0], [0.52, 0.0], [0.52, 0.355], [0.0, 0.355]]", "line = 17"}) {
    EXPECT_THAT(printed, HasSubstr(line));
  }
}

TEST(PrintConfig, PrintsNothingForWhatIsUnknown) {
  EXPECT_EQ(PrintConfig(Sample()).find("max_rate_m3_h"), std::string::npos);
}

TEST(PrintConfig, EscapesText) {
  const Config config = ParseConfig(Changed("\"depot-7\"", R"("a \"b\" \\ \u00e9\n")"), "bay.toml");
  EXPECT_EQ(ParseConfig(PrintConfig(config), "bay.toml").site_name, "a \"b\" \\ é\n");
}

class ShippedConfig : public ::testing::TestWithParam<const char*> {
 protected:
  std::filesystem::path file_ = std::filesystem::path(GRANARY_CONFIG_FOLDER) / GetParam();
};

TEST_P(ShippedConfig, HasNoFault) {
  try {
    static_cast<void>(ParseConfig(ReadText(file_), file_));
  } catch (const ConfigError& error) {
    FAIL() << error.what();
  }
}

TEST_P(ShippedConfig, ReadsBackFromPrint) {
  const std::string once = PrintConfig(ParseConfig(ReadText(file_), file_));
  EXPECT_EQ(PrintConfig(ParseConfig(once, file_)), once);
}

INSTANTIATE_TEST_SUITE_P(Files, ShippedConfig, ::testing::Values("granaryd.toml", "demo.toml", "examples/replay.toml"));

TEST(LoadConfig, ReadsAFileWhoseRigFilesExist) {
  const std::filesystem::path folder = ::testing::TempDir() + "granary_load_config";
  std::filesystem::create_directories(folder);
  for (const char* name : {"stereo.yml", "world.yml"}) std::ofstream(folder / name) << "%YAML:1.0\n";
  std::ofstream(folder / "bay.toml") << kSample;
  EXPECT_EQ(LoadConfig(folder / "bay.toml").bins.at(0).rigs.at(0).pose, folder / "world.yml");
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace granary
