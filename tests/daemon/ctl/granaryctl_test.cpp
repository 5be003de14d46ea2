// Usage, exit codes and streams of granaryctl, and its answers to bad files: nothing here measures.
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "daemon/store.h"
#include "pipeline/cloud_files.h"
#include "pipeline/frame_file.h"
#include "tests/daemon/ctl/run_program.h"

namespace granary {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr const char* kStereo =
    "%YAML:1.0\n---\nimage_width: 64\nimage_height: 48\n"
    "K1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 60., 0., 32., 0., 60., 24., 0., 0., 1. ]\n"
    "D1: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ 0., 0., 0., 0., 0. ]\n"
    "K2: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 60., 0., 32., 0., 60., 24., 0., 0., 1. ]\n"
    "D2: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ 0., 0., 0., 0., 0. ]\n"
    "R: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]\n"
    "T: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [ -0.11, 0., 0. ]\n";
constexpr const char* kWorld =
    "%YAML:1.0\n---\nT_world_left: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n"
    "   data: [ 1., 0., 0., 0.2, 0., -1., 0., 0.15, 0., 0., -1., 1., 0., 0., 0., 1. ]\n";

std::string BinToml(int id) {
  return "[[bin]]\nid = " + std::to_string(id) + "\nname = \"bay-" + std::to_string(id) +
         "\"\nfootprint_m = [[0,0],[0.4,0],[0.4,0.3],[0,0.3]]\nheight_m = 0.3\n"
         "[[bin.rig]]\nname = \"a\"\ncalibration = \"stereo.yml\"\npose = \"world.yml\"\n"
         "left = { driver = \"replay\", files = [\"l.png\"] }\nright = { driver = \"replay\", files = [\"r.png\"] }\n"
         "projector = { driver = \"none\" }\n";
}

/// A bin on files: 64 × 48 pictures l.png and r.png that hold nothing worth measuring.
class Ctl : public testing::Test {
 protected:
  Ctl() {
    folder_.Write("stereo.yml", kStereo);
    folder_.Write("world.yml", kWorld);
    folder_.Write("one.toml", BinToml(1));
    folder_.Write("two.toml", BinToml(1) + BinToml(2));
    cv::setRNGSeed(3);
    cv::Mat image(48, 64, CV_8UC1);
    cv::randu(image, 0, 256);
    SaveFrame(folder_ / "l.png", image);
    SaveFrame(folder_ / "r.png", image);
    SaveFrame(folder_ / "deep.png", cv::Mat(48, 64, CV_16UC1, cv::Scalar(900)));
    SaveFrame(folder_ / "colour.png", cv::Mat(48, 64, CV_8UC3, cv::Scalar(1, 2, 3)));
    SaveFrame(folder_ / "small.png", cv::Mat(20, 20, CV_8UC1, cv::Scalar(90)));
    SaveFrame(folder_ / "black.png", cv::Mat(48, 64, CV_8UC1, cv::Scalar(0)));
    const std::string whole = TemporaryFolder::Read(folder_ / "l.png");
    folder_.Write("cut.png", whole.substr(0, whole.size() / 2));
  }
  [[nodiscard]] ProgramRun Run(const std::string& arguments) const { return folder_.Run(arguments); }
  /// Runs with --json and expects one document with an error, and nothing valid.
  [[nodiscard]] std::string Error(const std::string& arguments, int exit_code) const {
    const ProgramRun run = Run("--json " + arguments);
    EXPECT_EQ(run.exit_code, exit_code) << arguments << "\n" << run.err;
    const auto document = run.Document();
    return document.is_object() && document.contains("error") ? document["error"].get<std::string>() : "";
  }
  CtlFolder folder_;
};

TEST_F(Ctl, HelpIsNoFailure) {
  for (const char* arguments : {"--help", "measure --help", "--version"}) {
    const ProgramRun run = Run(arguments);
    EXPECT_EQ(run.exit_code, 0) << arguments;
    EXPECT_THAT(run.out, HasSubstr("granaryctl")) << arguments;
  }
}
TEST_F(Ctl, BadUsageExitsWithTwoAndLeavesStandardOutputAlone) {
  for (const char* arguments :
       {"", "nonsense", "measure --nonsense", "disparity l.png r.png -o d.pfm",
        "disparity l.png --num-disparities 16 -o d.pfm", "disparity l.png r.png --num-disparities 0 -o d.pfm",
        "disparity l.png r.png --num-disparities many -o d.pfm", "registers --format pdf", "history --last -1",
        "snapshot", "--bin one measure", "measure --threshold", "sweep --from much", "sweep --frames",
        "sweep --volume"}) {
    const ProgramRun run = Run(arguments);
    EXPECT_EQ(run.exit_code, 2) << arguments;
    EXPECT_EQ(run.out, "") << arguments;
    EXPECT_NE(run.err, "") << arguments;
  }
}
TEST_F(Ctl, BadUsageWithJsonIsOneDocument) {
  EXPECT_NE(Error("nonsense", 2), "");
  EXPECT_NE(Error("disparity l.png r.png", 2), "");
}
TEST_F(Ctl, GlobalOptionsMayFollowTheCommand) {
  for (const char* arguments : {"--json -c one.toml --bin 7 measure", "measure --json -c one.toml --bin 7",
                                "-c one.toml measure --bin 7 --json", "measure --config one.toml --bin=7 --json"}) {
    const ProgramRun run = Run(arguments);
    EXPECT_EQ(run.exit_code, 2) << arguments;
    EXPECT_THAT(run.Document().value("error", ""), AllOf(HasSubstr("--bin 7"), HasSubstr("only bin 1"))) << arguments;
  }
}
TEST_F(Ctl, SeveralBinsNeedAChoice) {
  EXPECT_THAT(Error("-c two.toml measure", 2), AllOf(HasSubstr("--bin is needed"), HasSubstr("1, 2")));
}
TEST_F(Ctl, AnUnknownRigIsNamed) {
  EXPECT_THAT(Error("-c one.toml measure --rig z", 2), AllOf(HasSubstr("--rig z"), HasSubstr("has a")));
}
TEST_F(Ctl, AMissingConfigurationIsNamed) { EXPECT_THAT(Error("-c none.toml measure", 1), HasSubstr("none.toml")); }
TEST_F(Ctl, ATypoInAKeyIsNamedWithItsLine) {
  folder_.Write("typo.toml", "[site]\nnam = \"x\"\n" + BinToml(1));
  EXPECT_THAT(Error("-c typo.toml measure", 1), AllOf(HasSubstr("typo.toml:2"), HasSubstr("nam")));
}
TEST_F(Ctl, BadFramesAreNamed) {
  const auto error = [&](const std::string& frames) { return Error("-c one.toml measure --frames " + frames, 1); };
  EXPECT_THAT(error("absent.png r.png"), AllOf(HasSubstr("absent.png"), HasSubstr("No such file")));
  EXPECT_THAT(error("l.png cut.png"), AllOf(HasSubstr("cut.png"), HasSubstr("truncated")));
  EXPECT_THAT(error("colour.png r.png"), AllOf(HasSubstr("colour.png"), HasSubstr("colour picture")));
  EXPECT_THAT(error("l.png small.png"), AllOf(HasSubstr("right is 20x20"), HasSubstr("64x48")));
  EXPECT_THAT(error("l.png deep.png"), AllOf(HasSubstr("right is 16-bit"), HasSubstr("8-bit")));
}
TEST_F(Ctl, BadFramesMakeNoReference) {
  EXPECT_THAT(Error("-c one.toml reference --frames l.png cut.png", 1), HasSubstr("truncated"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "state/reference"));
}
TEST_F(Ctl, TheNumberOfFilesMustFitTheRigs) {
  EXPECT_THAT(Error("-c one.toml measure --frames l.png", 2), HasSubstr("1 files for 1 rig"));
  EXPECT_THAT(Error("-c one.toml measure --frames l.png r.png --ambient l.png", 2), HasSubstr("--ambient"));
  EXPECT_THAT(Error("-c one.toml measure --ambient l.png r.png", 2), HasSubstr("--ambient goes with --frames"));
  EXPECT_THAT(Error("-c one.toml reference --frames l.png r.png l.png r.png", 2), HasSubstr("one pair"));
}
TEST_F(Ctl, AThresholdMustBePositive) {
  EXPECT_THAT(Error("-c one.toml measure --threshold 0", 2), HasSubstr("--threshold"));
}
TEST_F(Ctl, ASweepNeedsARangeOfThresholds) {
  EXPECT_THAT(Error("-c one.toml sweep --from 0", 2), HasSubstr("--from"));
  EXPECT_THAT(Error("-c one.toml sweep --from 0.005 --to 0.004", 2), HasSubstr("--to"));
  EXPECT_THAT(Error("-c one.toml sweep --step -1", 2), HasSubstr("--step"));
  EXPECT_THAT(Error("-c one.toml sweep --step 1e-6", 2), HasSubstr("at most 1000"));
}
TEST_F(Ctl, ASweepNamesArgumentsThatCannotBe) {
  EXPECT_THAT(Error("-c one.toml sweep --repeats 0", 2), HasSubstr("--repeats"));
  EXPECT_THAT(Error("-c one.toml sweep --volume 0", 2), HasSubstr("--volume"));
  EXPECT_THAT(Error("-c one.toml sweep --frames l.png r.png l.png", 2), HasSubstr("3 files for 1 rig"));
  EXPECT_THAT(Error("-c one.toml sweep --frames l.png r.png --ambient l.png", 2), HasSubstr("--ambient"));
  EXPECT_THAT(Error("-c one.toml sweep --ambient l.png r.png", 2), HasSubstr("--ambient goes with --frames"));
}
TEST_F(Ctl, ASweepRefusesAMeasurementThatIsInvalidWithItsReason) {
  EXPECT_THAT(Error("-c one.toml sweep --frames black.png black.png", 1),
              AllOf(HasSubstr("measurement 1 of 1"), HasSubstr("dark")));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "sweep.csv"));
}
TEST_F(Ctl, AStereoFileWithAMissingKeyIsNamed) {
  folder_.Write("stereo.yml", std::string(kStereo).replace(std::string(kStereo).find("K2:"), 3, "X2:"));
  EXPECT_THAT(Error("-c one.toml measure", 1), AllOf(HasSubstr("stereo.yml"), HasSubstr("K2: is missing")));
}
TEST_F(Ctl, AStereoFileWithNanIsNamed) {
  folder_.Write("stereo.yml", std::string(kStereo).replace(std::string(kStereo).find("-0.11"), 5, ".Nan "));
  EXPECT_THAT(Error("-c one.toml measure", 1), AllOf(HasSubstr("stereo.yml"), HasSubstr("T: element [0][0] is nan")));
}
TEST_F(Ctl, ABlackPairIsAnInvalidRecord) {
  const ProgramRun run = Run("-c one.toml measure --json --frames black.png black.png");
  EXPECT_EQ(run.exit_code, 1);
  const auto record = run.Document();
  EXPECT_EQ(record["valid"], false);
  EXPECT_NE(record["reason"], "ok");
  EXPECT_TRUE(record["volume_m3"].is_null());
}
TEST_F(Ctl, FramesOfAnotherSizeThanTheCalibrationAreAnInvalidRecord) {
  const ProgramRun run = Run("-c one.toml measure --json --frames small.png small.png");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.Document()["reason"], "frame_invalid");
}
TEST_F(Ctl, ABlackPairMakesNoReference) {
  EXPECT_THAT(Error("-c one.toml reference --frames black.png black.png", 1), HasSubstr("makes no reference"));
}
TEST_F(Ctl, SnapshotSavesThePair) {
  const ProgramRun run = Run("-c one.toml snapshot -o shots --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(run.Document()["left"], "shots/left.png");
  EXPECT_EQ(cv::norm(LoadFrame(folder_ / "shots/left.png").image, LoadFrame(folder_ / "l.png").image), 0);
}
TEST_F(Ctl, SnapshotWithoutAFolderToWriteFails) {
  folder_.Write("file", "x");
  EXPECT_THAT(Error("-c one.toml snapshot -o file/shots", 1), HasSubstr("file/shots"));
}

TEST_F(Ctl, DisparityWritesAPfmOfThePicture) {
  const ProgramRun run = Run("disparity l.png r.png --num-disparities 16 -o d.pfm");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(run.out, "");
  EXPECT_EQ(ReadPfm(folder_ / "d.pfm").size(), cv::Size(64, 48));
}
TEST_F(Ctl, DisparityTurnsColourIntoGreyAndSaysSo) {
  const ProgramRun run = Run("disparity colour.png colour.png --num-disparities 16 -o d.pfm --json");
  EXPECT_EQ(run.exit_code, 0);
  EXPECT_THAT(run.err, HasSubstr("colour.png: is in colour, turned into grey"));
  EXPECT_EQ(run.Document()["width"], 64);
}
TEST_F(Ctl, DisparityRefusesPairsThatDiffer) {
  EXPECT_THAT(Error("disparity l.png small.png --num-disparities 16 -o d.pfm", 1), HasSubstr("one size"));
  EXPECT_THAT(Error("disparity l.png deep.png --num-disparities 16 -o d.pfm", 1), HasSubstr("one depth"));
  EXPECT_THAT(Error("disparity l.png cut.png --num-disparities 16 -o d.pfm", 1), HasSubstr("truncated"));
}
TEST_F(Ctl, DisparityNamesAnOutputItCannotWrite) {
  EXPECT_THAT(Error("disparity l.png r.png --num-disparities 16 -o nowhere/d.pfm", 1), HasSubstr("nowhere/d.pfm"));
  EXPECT_THAT(Error("disparity l.png r.png --num-disparities 16 -o /dev/full", 1), HasSubstr("No space left"));
}

TEST_F(Ctl, RegistersComeInEveryFormat) {
  for (const char* format : {"text", "csv", "json", "markdown"}) {
    const ProgramRun run = Run(std::string("registers --format ") + format);
    EXPECT_EQ(run.exit_code, 0) << format;
    EXPECT_THAT(run.out, HasSubstr("volume")) << format;
    EXPECT_EQ(run.err, "") << format;
  }
  EXPECT_TRUE(Run("registers --json").Document().contains("registers"));
}
TEST_F(Ctl, RegistersCannotBeCsvAndJson) {
  EXPECT_THAT(Error("registers --format csv", 2), HasSubstr("--json prints JSON"));
}
TEST_F(Ctl, AFullStandardOutputIsAFailure) {
  // The shell keeps the last redirection.
  EXPECT_EQ(Run("registers >/dev/full 2>/dev/null; exit $?; true").exit_code, 1);
}

TEST_F(Ctl, HistoryWithoutAStoreFails) { EXPECT_NE(Error("history", 1), ""); }
TEST_F(Ctl, HistoryIsAnArrayNewestLast) {
  {
    Store store(folder_ / "state");
    for (int i = 1; i <= 3; ++i) {
      Measurement m;
      m.bin = i == 2 ? 2 : 1;
      m.sequence = static_cast<std::uint64_t>(i);
      m.utc = UtcTime(std::chrono::seconds(1'795'000'000 + i));
      store.Append(m);
    }
  }
  const auto all = Run("history --json").Document();
  ASSERT_EQ(all.size(), 3U);
  EXPECT_EQ(all[2]["sequence"], 3);
  EXPECT_EQ(Run("history --json --bin 1").Document().size(), 2U);
  EXPECT_EQ(Run("history --json --last 1").Document()[0]["sequence"], 3);
  const ProgramRun text = Run("history");
  EXPECT_EQ(text.out, "");
  EXPECT_THAT(text.err, HasSubstr("not_measured"));
}

// What is found depends on the machine; that it is a list does not.
TEST(Granaryctl, ListsTheCamerasThereAre) {
  const CtlFolder folder;
  const ProgramRun run = folder.Run("cameras --json");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const auto cameras = run.Document();
  ASSERT_TRUE(cameras.is_array());
  for (const auto& camera : cameras) {
    EXPECT_THAT(camera["driver"].get<std::string>(), testing::AnyOf("aravis", "v4l2"));
    EXPECT_FALSE(camera["id"].get<std::string>().empty());
  }
}

TEST(Granaryctl, SaysThatACameraOfTheConfigurationIsNotThere) {
  const CtlFolder folder;
  folder.Write("stereo.yml", kStereo);
  folder.Write("world.yml", kWorld);
  folder.Write("bin.toml",
               "[[bin]]\nid = 1\nfootprint_m = [[0, 0], [0.4, 0], [0.4, 0.3], [0, 0.3]]\nheight_m = 0.3\n"
               "schedule = { every = \"1h\" }\n[[bin.rig]]\ncalibration = \"stereo.yml\"\npose = \"world.yml\"\n"
               "left = { driver = \"v4l2\", trigger = \"free\", id = \"/dev/v4l/by-path/no-such-left\" }\n"
               "right = { driver = \"v4l2\", trigger = \"free\", id = \"/dev/v4l/by-path/no-such-right\" }\n");
  const ProgramRun run = folder.Run("-c bin.toml snapshot -o shots");
  EXPECT_EQ(run.exit_code, 1) << run.err;
  EXPECT_THAT(run.err, testing::HasSubstr("/dev/v4l/by-path/no-such-left"));
  EXPECT_FALSE(std::filesystem::exists(folder / "shots/left.png"));
}

}  // namespace
}  // namespace granary
