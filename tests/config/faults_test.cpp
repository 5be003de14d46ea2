// Bad configurations: each slip gives one fault, at its line, under its key, with what is allowed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "config/config.h"
#include "tests/config/sample.h"

namespace granary {
namespace {

using testing::Changed;
using testing::FaultsOf;
using ::testing::HasSubstr;
using testing::kSample;
using testing::LineOf;
using testing::Texts;

/// One slip of the pen: `from` in the sample becomes `to`; the fault stands at the line of `at` (of `to` when empty).
struct Slip {
  const char* name;
  std::string from, to, key, words;
  std::string at = {};
};

std::string NameOf(const ::testing::TestParamInfo<Slip>& slip) { return slip.param.name; }

class ParseConfigSlip : public ::testing::TestWithParam<Slip> {};

TEST_P(ParseConfigSlip, GivesOneFaultAtItsLine) {
  const Slip& slip = GetParam();
  const std::string text = Changed(slip.from, slip.to);
  const auto faults = FaultsOf(text);
  ASSERT_EQ(faults.size(), 1U) << Texts(faults);
  EXPECT_EQ(faults[0].key, slip.key);
  EXPECT_THAT(faults[0].message, HasSubstr(slip.words));
  EXPECT_EQ(faults[0].line, LineOf(slip.at.empty() ? slip.to : slip.at, text)) << faults[0].Text();
}

const std::string kLeft = "left  = { driver = \"aravis\", id = \"Vendor-Serial\", exposure_us = 8000, gain_db = 0 }";
const std::string kRight = "right = { driver = \"v4l2\", id = \"/dev/v4l/by-path/…\" }";
const std::string kFootprint = "footprint_m = [[0,0],[0.52,0],[0.52,0.355],[0,0.355]]";
const std::string kSchedule = "schedule = { every = \"30min\" }";
const std::string kTcp = "[modbus.tcp]";

INSTANTIATE_TEST_SUITE_P(
    Keys, ParseConfigSlip,
    ::testing::Values(
        Slip{"UnknownKey", "height_m = 0.285", "hieght_m = 0.285\nheight_m = 0.285", "bin[0].hieght_m",
             "did you mean height_m?; allowed: id, name, footprint_m"},
        Slip{"UnknownTable", "[log]", "[logs]", "logs", "did you mean log?"},
        Slip{"UnknownInlineKey", "exposure_us = 8000", "exposure = 8000", "bin[0].rig[0].left.exposure",
             "did you mean exposure_us?"},
        Slip{"UnknownWord", "name = \"depot-7\"", "zzzzzzzzzz = 1", "site.zzzzzzzzzz", "is no key here; allowed: name"},
        Slip{"MissingId", "id = 1  ", "#", "bin[0].id", "is missing; must be a whole number: 1 to 247", "[[bin]]"},
        Slip{"MissingFootprint", kFootprint, "#", "bin[0].footprint_m", "is missing", "[[bin]]"},
        Slip{"MissingHeight", "height_m = 0.285", "#", "bin[0].height_m", "is missing", "[[bin]]"},
        Slip{"MissingCalibration", "calibration = \"stereo.yml\"", "#", "bin[0].rig[0].calibration", "is missing",
             "[[bin.rig]]"},
        Slip{"MissingPose", "pose = \"world.yml\"", "#", "bin[0].rig[0].pose", "is missing", "[[bin.rig]]"},
        Slip{"MissingLeft", kLeft, "#", "bin[0].rig[0].left", "is missing", "[[bin.rig]]"},
        Slip{"MissingDriver", kRight, "right = { id = \"x\" }", "bin[0].rig[0].right.driver", "is missing"},
        Slip{"MissingDevice", "device = \"/dev/ttyS1\"", "#", "modbus.rtu.device", "is missing", "[modbus.rtu]"},
        Slip{"SingleBracketBin", "[[bin]]", "[bin]", "bin", "each under a header in double brackets", "[bin]"},
        Slip{"ScalarForTable", "[log]\nlevel = \"warn\"", "[[log]]\nlevel = \"warn\"", "log", "must be a table"}),
    NameOf);

INSTANTIATE_TEST_SUITE_P(
    Types, ParseConfigSlip,
    ::testing::Values(
        Slip{"TextForNumber", "height_m = 0.285", "height_m = \"0.285\"", "bin[0].height_m",
             "is the string \"0.285\"; must be a number (m): more than 0 and at most 100"},
        Slip{"FractionForWhole", "baud = 19200", "baud = 19200.5", "modbus.rtu.baud", "must be a whole number"},
        Slip{"HugeWhole", "baud = 19200", "baud = 99999999999", "modbus.rtu.baud", "must be a whole number"},
        Slip{"NumberForText", "name = \"bay-1\"", "name = 1", "bin[0].name", "is the number 1; must be a string"},
        Slip{"EmptyText", "name = \"bay-1\"", "name = \"\"", "bin[0].name", "is empty"},
        Slip{"TextForArray", "allow = [\"192.168.7.0/24\"]", "allow = \"192.168.7.0/24\"", "modbus.tcp.allow",
             "must be an array"},
        Slip{"NumberInTexts", "allow = [\"192.168.7.0/24\"]", "allow = [7]", "modbus.tcp.allow[0]", "must be a string"},
        Slip{"NumberForPath", "pose = \"world.yml\"", "pose = 1", "bin[0].rig[0].pose", "must be a path"},
        Slip{"NumberForDuration", kSchedule, "schedule = { every = 30 }", "bin[0].schedule.every",
             "must be a duration with its unit"},
        Slip{"DurationWithoutUnit", kSchedule, "schedule = { every = \"30\" }", "bin[0].schedule.every",
             "is the string \"30\"; must be a duration"},
        Slip{"TextForCount", "max_skew_us = 500", "max_skew_us = \"500us\"", "bin[0].rig[0].max_skew_us",
             "must be a whole number (us)"},
        Slip{"WordForChoice", "parity = \"even\"", "parity = \"evne\"", "modbus.rtu.parity",
             "(did you mean \"even\"?); must be a string: none | even | odd"},
        Slip{"NumberForChoice", "level = \"warn\"", "level = 2", "log.level", "is the number 2"},
        Slip{"ThreeNumbersForCorner", "[0.52,0],", "[0.52,0,1],", "bin[0].footprint_m[1]", "must be a corner [x, y]"},
        Slip{"TextInCorner", "[0.52,0],", "[0.52,\"0\"],", "bin[0].footprint_m[1][1]", "must be a number"},
        Slip{"InfiniteNumber", "height_m = 0.285", "height_m = inf", "bin[0].height_m", "is inf; must be finite"},
        Slip{"NotANumber", "correction = 1.0", "correction = nan", "bin[0].inventory.correction", "is nan"},
        Slip{"InfiniteCorner", "[0.52,0],", "[0.52,nan],", "bin[0].footprint_m[1][1]", "is nan; must be finite"}),
    NameOf);

INSTANTIATE_TEST_SUITE_P(
    Ranges, ParseConfigSlip,
    ::testing::Values(
        Slip{"IdZero", "id = 1  ", "id = 0  ", "bin[0].id", "is the number 0; must be 1 to 247"},
        Slip{"IdTooLarge", "id = 1  ", "id = 248", "bin[0].id", "must be 1 to 247"},
        Slip{"HeightZero", "height_m = 0.285", "height_m = 0", "bin[0].height_m", "must be more than 0"},
        Slip{"TwoCorners", kFootprint, "footprint_m = [[0,0],[1,0]]", "bin[0].footprint_m", "at least 3"},
        Slip{"CrossingFootprint", kFootprint, "footprint_m = [[0,0],[1,1],[1,0],[0,2]]", "bin[0].footprint_m",
             "crosses itself"},
        Slip{"FlatFootprint", kFootprint, "footprint_m = [[0,0],[1,1],[2,2]]", "bin[0].footprint_m", "has no area"},
        Slip{"Millimetres", kFootprint, "footprint_m = [[0,0],[520,0],[520,355],[0,355]]", "bin[0].footprint_m",
             "coordinates are metres"},
        Slip{"TwoCornersExcluded", "exclude_m = []", "exclude_m = [[[0,0],[0.1,0]]]", "bin[0].exclude_m[0]",
             "at least 3"},
        Slip{"ExcludedOutside", "exclude_m = []", "exclude_m = [[[0.1,0.1],[0.9,0.1],[0.1,0.2]]]",
             "bin[0].exclude_m[0]", "must lie inside footprint_m"},
        Slip{"NegativeBook", "book_mass_kg = 15200.0", "book_mass_kg = -1", "bin[0].inventory.book_mass_kg",
             "must be 0 or more"},
        Slip{"DensityInTonnes", "density_kg_m3 = 790.0", "density_kg_m3 = 0.79", "bin[0].inventory.density_kg_m3",
             "is the number 0.79; must be 1 to 2000"},
        Slip{"NoCorrection", "correction = 1.0", "correction = 0", "bin[0].inventory.correction",
             "must be more than 0"},
        Slip{"NegativeLoss", "loss_kg = 0.0", "loss_kg = -0.5", "bin[0].inventory.loss_kg", "must be 0 or more"},
        Slip{"NoAlarm", "alarm_percent = 3.0", "alarm_percent = 0", "bin[0].inventory.alarm_percent",
             "must be more than 0"},
        Slip{"BothSchedules", kSchedule, "schedule = { every = \"1h\", at = [\"06:00\"] }", "bin[0].schedule",
             "has both every and at"},
        Slip{"NoSchedule", kSchedule, "schedule = { timezone = \"UTC\" }", "bin[0].schedule",
             "has neither every nor at"},
        Slip{"EmptyAt", kSchedule, "schedule = { at = [] }", "bin[0].schedule.at", "at least one"},
        Slip{"BadTime", kSchedule, "schedule = { at = [\"24:00\"] }", "bin[0].schedule.at[0]",
             "must be a time of the day"},
        Slip{"TimeTwice", kSchedule, "schedule = { at = [\"06:00\", \"06:00\"] }", "bin[0].schedule.at", "twice"},
        Slip{"BadZone", kSchedule, "schedule = { at = [\"06:00\"], timezone = \"Asia/Shangai\" }",
             "bin[0].schedule.timezone", "'Asia/Shangai' is no time zone"},
        Slip{"TooOften", kSchedule, "schedule = { every = \"99ms\" }", "bin[0].schedule.every", "100ms"},
        Slip{"NoPort", "listen = \"0.0.0.0:502\"", "listen = \"0.0.0.0\"", "modbus.tcp.listen", "ADDRESS:PORT"},
        Slip{"PortTooLarge", "listen = \"0.0.0.0:502\"", "listen = \"0.0.0.0:65536\"", "modbus.tcp.listen",
             "port 1 to 65535"},
        Slip{"NameForAddress", "listen = \"0.0.0.0:502\"", "listen = \"depot:502\"", "modbus.tcp.listen",
             "ADDRESS:PORT"},
        Slip{"BareV6", "listen = \"0.0.0.0:502\"", "listen = \"::1:502\"", "modbus.tcp.listen", "[IPV6]:PORT"},
        Slip{"BadNetwork", "allow = [\"192.168.7.0/24\"]", "allow = [\"192.168.7.0/33\"]", "modbus.tcp.allow[0]",
             "'192.168.7.0/33' is no network; must be ADDRESS/PREFIX"},
        Slip{"HostForNetwork", "allow = [\"192.168.7.0/24\"]", "allow = [\"192.168.7.5/24\"]", "modbus.tcp.allow[0]",
             "must be 192.168.7.0/24 for the network or /32"},
        Slip{"BadWriter", "write_allow = []", "write_allow = [\"plc\"]", "modbus.tcp.write_allow[0]", "is no network"},
        Slip{"NoClients", kTcp, "[modbus.tcp]\nmax_clients = 0", "modbus.tcp.max_clients", "must be 1 to 1000",
             "max_clients = 0"},
        Slip{"OddBaud", "baud = 19200", "baud = 19201", "modbus.rtu.baud", "is the number 19201; must be 1200"},
        Slip{"PlcWithoutPort", "address = \"192.168.7.20:502\"", "address = \"192.168.7.20\"", "modbus.plc.address",
             "HOST:PORT"},
        Slip{"PlcUnit", "unit = 1", "unit = 256", "modbus.plc.unit", "must be 0 to 255"},
        Slip{"PlcBase", "base = 0", "base = 65536", "modbus.plc.base", "must be 0 to 65471"},
        Slip{"NoAttempts", "[bin.inventory]", "[bin.cycle]\nattempts = 0\n[bin.inventory]", "bin[0].cycle.attempts",
             "is the number 0; must be 1 to 20", "attempts = 0"},
        Slip{"EvenCensus", "[bin.inventory]", "[bin.stereo]\ncensus_width = 4\n[bin.inventory]",
             "bin[0].stereo.census_width", "must be 3, 5, 7 or 9", "census_width"},
        Slip{"CoverageAboveOne", "[bin.inventory]", "[bin.surface]\nreduced_coverage = 85\n[bin.inventory]",
             "bin[0].surface.reduced_coverage", "must be min_coverage to 1", "reduced_coverage"},
        Slip{"DefaultOutOfRangeByAnotherKey", "[bin.inventory]", "[bin.stereo]\np1 = 100\n[bin.inventory]",
             "bin[0].stereo.p2", "must be more than p1", "[bin.stereo]"}),
    NameOf);

INSTANTIATE_TEST_SUITE_P(
    Rigs, ParseConfigSlip,
    ::testing::Values(
        Slip{"UnknownDriver", "driver = \"aravis\"", "driver = \"gige\"", "bin[0].rig[0].left.driver",
             "is the string \"gige\"; must be a string: aravis | v4l2 | replay | sim"},
        Slip{"NoId", kRight, "right = { driver = \"v4l2\" }", "bin[0].rig[0].right.id", "is missing"},
        Slip{"NoFiles", kRight, "right = { driver = \"replay\" }", "bin[0].rig[0].right.files", "replay"},
        Slip{"OneSim", "projector = { driver = \"gpio\"", "projector = { driver = \"gpip\"",
             "bin[0].rig[0].projector.driver", "did you mean \"gpio\"?"},
        Slip{"NoChip", "chip = \"/dev/gpiochip0\", ", "", "bin[0].rig[0].projector.chip", "is missing", "projector ="},
        Slip{"NegativeExposure", "exposure_us = 8000", "exposure_us = -1", "bin[0].rig[0].left.exposure_us",
             "must be 1 to 1000000"},
        Slip{"UnknownTrigger", "gain_db = 0", "gain_db = 0, trigger = \"line1\"", "bin[0].rig[0].left.trigger",
             "did you mean \"line0\"?"},
        Slip{"FeatureThatIsNoValue", "gain_db = 0", "gain_db = 0, features = { Lut = [1, 2] }",
             "bin[0].rig[0].left.features.Lut", "must be true or false, a number or a string"},
        Slip{"FeaturesThatAreNoTable", "gain_db = 0", "gain_db = 0, features = \"Lut\"", "bin[0].rig[0].left.features",
             "must be a table in braces"},
        Slip{"ThreeNumbersOfARegion", "gain_db = 0", "gain_db = 0, roi_px = [0, 0, 100]", "bin[0].rig[0].left.roi_px",
             "[x, y, width, height]"},
        Slip{"NoDuty", "max_on_ms = 50", "max_on_ms = 50, max_duty_percent = 0",
             "bin[0].rig[0].projector.max_duty_percent", "more than 0"},
        Slip{"DarkPairOnOneLine", "max_skew_us = 500", "max_skew_us = 500\nambient = true", "bin[0].rig[0].ambient",
             "projector.trigger_line", "ambient ="},
        Slip{"UnknownShape", "[[bin.rig]]", "[[bin.rig]]\nsim = { shape = \"heap\" }", "bin[0].rig[0].sim.shape",
             "flat | tilted_left | tilted_right | convex | concave | partial", "sim = {"},
        Slip{"NegativeSeed", "[[bin.rig]]", "[[bin.rig]]\nsim = { seed = -1 }", "bin[0].rig[0].sim.seed",
             "not negative", "sim = {"}),
    NameOf);

TEST(ParseConfig, WantsBothCamerasSimulatedOrNeither) {
  const auto text = Changed("projector = {", "#", Changed(kRight, "right = { driver = \"sim\" }"));
  const auto faults = FaultsOf(text);
  ASSERT_EQ(faults.size(), 1U) << Texts(faults);
  EXPECT_EQ(faults[0].key, "bin[0].rig[0].right.driver");
  EXPECT_EQ(faults[0].line, LineOf("right = {", text));
}

TEST(ParseConfig, DoesNotCompareWithADriverThatItCouldNotRead) {
  const auto faults = FaultsOf(Changed("driver = \"aravis\"", "driver = \"arvais\""));
  ASSERT_EQ(faults.size(), 1U) << Texts(faults);
  EXPECT_EQ(faults[0].key, "bin[0].rig[0].left.driver");
}

TEST(ParseConfig, WantsABin) {
  const auto faults = FaultsOf("[site]\nname = \"depot-7\"\n");
  ASSERT_EQ(faults.size(), 1U) << Texts(faults);
  EXPECT_EQ(faults[0].key, "bin");
  EXPECT_THAT(faults[0].message, HasSubstr("at least one [[bin]]"));
}

TEST(ParseConfig, WantsARigInEachBin) {
  const auto text = kSample.substr(0, kSample.find("[[bin.rig]]"));
  const auto faults = FaultsOf(text);
  ASSERT_EQ(faults.size(), 1U) << Texts(faults);
  EXPECT_EQ(faults[0].Text(), "bay.toml:" + std::to_string(LineOf("[[bin]]", text)) +
                                  ": bin[0].rig: is missing; must be at least one [[bin.rig]]");
}

TEST(ParseConfig, NamesTheSecondOfTwoEqualIds) {
  const auto text = kSample + Changed("id = 1  ", "id = 001 ", kSample.substr(kSample.find("[[bin]]")));
  const auto faults = FaultsOf(Changed("id = 001 ", "id = 1 # again", text));
  ASSERT_EQ(faults.size(), 1U) << Texts(faults);
  EXPECT_EQ(faults[0].key, "bin[1].id");
  EXPECT_EQ(faults[0].line, LineOf("id = 001", text));
  EXPECT_THAT(faults[0].message, HasSubstr("bin[0]'s already; must be unique"));
}

TEST(ParseConfig, NamesTheSecondOfTwoEqualRigs) {
  const auto text = kSample + Changed("name = \"a\"", "name = 'a'", kSample.substr(kSample.find("[[bin.rig]]")));
  const auto faults = FaultsOf(text);
  ASSERT_EQ(faults.size(), 1U) << Texts(faults);
  EXPECT_EQ(faults[0].key, "bin[0].rig[1].name");
  EXPECT_EQ(faults[0].line, LineOf("name = 'a'", text));
}

TEST(ParseConfig, ReportsEveryFaultInOnePass) {
  auto text = Changed("level = \"warn\"", "level = \"loud\"");
  text = Changed("listen = \"0.0.0.0:502\"", "listen = \"here\"", text);
  text = Changed("baud = 19200", "buad = 19200", text);
  text = Changed("height_m = 0.285", "height_m = -1", text);
  text = Changed("every = \"30min\"", "every = \"soon\"", text);
  text = Changed("density_kg_m3 = 790.0", "density_kg_m3 = true", text);
  text = Changed("calibration = \"stereo.yml\"\n", "", text);
  text = Changed("line = 17", "line = -17", text);
  std::vector<std::string> keys;
  for (const auto& fault : FaultsOf(text)) keys.push_back(fault.key);
  EXPECT_THAT(keys, ::testing::ElementsAre("log.level", "modbus.tcp.listen", "modbus.rtu.buad", "bin[0].height_m",
                                           "bin[0].schedule.every", "bin[0].inventory.density_kg_m3",
                                           "bin[0].rig[0].calibration", "bin[0].rig[0].projector.line"));
}

TEST(ParseConfig, NamesTheLineOfASyntaxError) {
  const auto text = Changed("height_m = 0.285", "height_m = ");
  const auto faults = FaultsOf(text);
  ASSERT_EQ(faults.size(), 1U);
  EXPECT_EQ(faults[0].line, LineOf("height_m = ", text));
  EXPECT_EQ(faults[0].key, "(syntax)");
}

TEST(ParseConfig, NamesTheLineOfAKeyGivenTwice) {
  const auto text = Changed("height_m = 0.285", "height_m = 0.285\nheight_m = 0.3 # again");
  const auto faults = FaultsOf(text);
  ASSERT_EQ(faults.size(), 1U);
  EXPECT_EQ(faults[0].line, LineOf("height_m = 0.3 # again", text));
}

TEST(ConfigError, ListsOneFaultALine) {
  const ConfigError error({{"a.toml", 3, "bin[0].id", "is 0"}, {"a.toml", 9, "log.level", "is loud"}});
  EXPECT_STREQ(error.what(), "a.toml:3: bin[0].id: is 0\na.toml:9: log.level: is loud");
}

TEST(LoadConfig, NamesAFileThatDoesNotExist) {
  try {
    static_cast<void>(LoadConfig("/nowhere/granaryd.toml"));
    FAIL();
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), HasSubstr("/nowhere/granaryd.toml:0: (file): does not exist"));
  }
}

TEST(LoadConfig, NamesAFolderGivenForAFile) {
  EXPECT_THROW(static_cast<void>(LoadConfig(::testing::TempDir())), ConfigError);
}

TEST(LoadConfig, NamesEachMissingRigFileAtItsLine) {
  const std::filesystem::path file = ::testing::TempDir() + "granary_without_rig_files.toml";
  std::ofstream(file) << kSample;
  try {
    static_cast<void>(LoadConfig(file));
    FAIL();
  } catch (const ConfigError& error) {
    ASSERT_EQ(error.faults().size(), 2U) << error.what();
    EXPECT_EQ(error.faults()[0].line, LineOf("calibration = ", kSample));
    EXPECT_EQ(error.faults()[0].key, "bin[0].rig[0].calibration");
    EXPECT_EQ(error.faults()[1].line, LineOf("pose = ", kSample));
    EXPECT_THAT(error.faults()[1].message, HasSubstr("world.yml does not exist"));
  }
  std::filesystem::remove(file);
}

TEST(ParseConfig, NamesASerialUnitThatIsNoBin) {
  const auto text = Changed("baud = 19200", "baud = 19200\nunits = [1, 2]");
  const auto faults = FaultsOf(text);
  ASSERT_EQ(faults.size(), 1U) << Texts(faults);
  EXPECT_EQ(faults[0].key, "modbus.rtu.units");
  EXPECT_THAT(faults[0].message, HasSubstr("has 2, which is no bin"));
  EXPECT_EQ(faults[0].line, LineOf("units = [1, 2]", text));
}

TEST(ParseConfig, NamesAFieldForThePlcThatIsNoRegister) {
  const auto faults = FaultsOf(Changed("unit = 1\n", "unit = 1\nfields = [\"volume\", \"wolume\"]\n"));
  ASSERT_EQ(faults.size(), 1U) << Texts(faults);
  EXPECT_THAT(faults[0].key, HasSubstr("modbus.plc.fields"));
  EXPECT_THAT(faults[0].message, HasSubstr("wolume"));
}

}  // namespace
}  // namespace granary
