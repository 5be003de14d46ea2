// granaryctl on the simulated bin of the demo: from nothing stored to a volume, and with a stored reference.
#include <cmath>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "pipeline/cloud_files.h"
#include "pipeline/frame_file.h"
#include "tests/daemon/ctl/run_program.h"

namespace granary {
namespace {

using testing::AllOf;
using testing::HasSubstr;

// The demo's bin holds 0.0193 m³ at its first measurement. 1.5 % is the paper's bound for any one measurement; the
// accuracy itself is the scene tests' business, here it only shows that the parts are joined rightly.
constexpr double kTruth_m3 = 0.0193, kTolerance_m3 = 0.015 * kTruth_m3;

std::string Demo(const std::string& arguments) { return std::string("-c ") + DEMO_CONFIG + " " + arguments; }

TEST(GranaryctlScene, MeasuresTheSimulatedBinAndSavesEveryIntermediate) {
  const CtlFolder folder;
  const ProgramRun run = folder.Run(Demo("measure --json --save saved"));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto record = run.Document();
  EXPECT_EQ(record["valid"], true);
  EXPECT_EQ(record["simulated"], true);
  EXPECT_EQ(record["sequence"], 0);
  EXPECT_NEAR(record["volume_m3"].get<double>(), kTruth_m3, kTolerance_m3);
  EXPECT_GT(record["timings_ms"]["capture"].get<double>(), 0);
  EXPECT_GT(record["peak_rss_mib"].get<double>(), 0);
  EXPECT_FALSE(std::filesystem::exists(folder / "state"));  // neither a record nor a reference is stored
  for (const char* name : {"rectified.png", "left_rectified.png", "right_rectified.png", "disparity.png", "grain.png",
                           "removed.png", "height.png", "mesh.png"}) {
    EXPECT_FALSE(ReadImage(folder / "saved" / name).empty()) << name;
  }
  EXPECT_EQ(ReadPfm(folder / "saved/disparity.pfm").size(), ReadPcd(folder / "saved/cloud.pcd").points.size());
  for (const char* name : {"cloud.ply", "mesh.ply", "removed.ply", "record.json"}) {
    EXPECT_GT(std::filesystem::file_size(folder / "saved" / name), 100U) << name;
  }
}

TEST(GranaryctlScene, ReferenceThenMeasureFromItsOwnSnapshots) {
  const CtlFolder folder;
  const auto reference = folder.Run(Demo("reference --json"));
  ASSERT_EQ(reference.exit_code, 0) << reference.err;
  const auto stored = reference.Document();
  EXPECT_EQ(stored["simulated"], true);
  EXPECT_GT(stored["coverage_percent"].get<double>(), 90);
  ASSERT_EQ(folder.Run(Demo("snapshot -o shots")).exit_code, 0);

  const ProgramRun run = folder.Run(Demo("measure --json --frames shots/left.png shots/right.png"));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto record = run.Document();
  EXPECT_EQ(record["reference_id"], stored["id"]);
  EXPECT_NEAR(record["volume_m3"].get<double>(), kTruth_m3, kTolerance_m3);
  EXPECT_THAT(run.err, HasSubstr("is of the simulator, the frames are not"));

  const ProgramRun swapped = folder.Run(Demo("measure --json --frames shots/right.png shots/left.png"));
  EXPECT_EQ(swapped.exit_code, 1);
  EXPECT_EQ(swapped.Document()["valid"], false);
}

// The demo's rig with other keys: four times the exposure that suits it, or a dark pair beside the lit one.
std::string DemoRigWith(const std::string& rig_keys, double exposure_us, const std::string& sim_keys = "") {
  const std::string sim = std::filesystem::path(DEMO_CONFIG).parent_path().string() + "/sim/";
  const std::string camera = "{ driver = \"sim\", exposure_us = " + std::to_string(exposure_us) + " }";
  return "[[bin]]\nid = 1\nfootprint_m = [[0.0, 0.0], [0.52, 0.0], [0.52, 0.355], [0.0, 0.355]]\nheight_m = 0.285\n"
         "[[bin.rig]]\ncalibration = \"" +
         sim + "stereo.yml\"\npose = \"" + sim + "world.yml\"\n" + rig_keys + "left = " + camera +
         "\nright = " + camera +
         "\nprojector = { driver = \"sim\" }\n"
         "[bin.rig.sim]\nvolume_m3 = 0.0193\n" +
         sim_keys;
}

TEST(GranaryctlScene, AnOverexposedPictureIsRefused) {
  const CtlFolder folder;
  folder.Write("bin.toml", DemoRigWith("", 32000));
  const ProgramRun run = folder.Run("-c bin.toml measure --json");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.out + run.err, HasSubstr("saturated"));
}

TEST(GranaryctlScene, ShorterExposuresSaveAnOverexposedPicture) {
  const CtlFolder folder;
  folder.Write("bin.toml", DemoRigWith("exposure_brackets = 2\n", 32000));
  const ProgramRun run = folder.Run("-c bin.toml measure --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NEAR(run.Document()["volume_m3"].get<double>(), kTruth_m3, kTolerance_m3);
}

TEST(GranaryctlScene, MeasuresWithTheDarkPairTakenOff) {
  const CtlFolder folder;
  folder.Write("bin.toml", DemoRigWith("ambient = true\n", 8000));
  const ProgramRun run = folder.Run("-c bin.toml measure --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NEAR(run.Document()["volume_m3"].get<double>(), kTruth_m3, kTolerance_m3);
  ASSERT_EQ(folder.Run("-c bin.toml snapshot -o shots").exit_code, 0);
  EXPECT_LT(cv::mean(ReadImage(folder / "shots/ambient_left.png"))[0],
            cv::mean(ReadImage(folder / "shots/left.png"))[0]);
}

TEST(GranaryctlScene, ADeadLampIsToldByTheDarkPair) {
  const CtlFolder folder;
  folder.Write("bin.toml", DemoRigWith("ambient = true\n", 8000, "projector_works = false\n"));
  const ProgramRun run = folder.Run("-c bin.toml snapshot -o shots");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.err, HasSubstr("no brighter than with the projector off"));
}

TEST(GranaryctlScene, SnapshotTellsHowThePairWasTaken) {
  const CtlFolder folder;
  const ProgramRun run = folder.Run(Demo("snapshot -o shots --json"));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto told = run.Document();
  EXPECT_EQ(told["skew_us"], 0);  // the simulator exposes both at once
  EXPECT_GT(told["pulse_us"].get<double>(), 8000);
  EXPECT_EQ(told["ambient"], false);
  EXPECT_TRUE(told["temperature_c"][0].is_null());
}

TEST(GranaryctlScene, MeterShowsContrastOfBothPictures) {
  const CtlFolder folder;
  const ProgramRun run = folder.Run(Demo("meter --count 3 --every 0 --json"));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, AllOf(HasSubstr("pairs/s"), HasSubstr("contrast"), HasSubstr("(simulated)")));
  const auto last = run.Document();
  for (const char* side : {"left", "right"}) {
    EXPECT_GT(last[side]["speckle_contrast"].get<double>(), 0.05) << side;  // what the daemon asks for
    EXPECT_GT(last[side]["mean_fraction"].get<double>(), 0.01) << side;
  }
  EXPECT_GT(last["pairs_per_s"].get<double>(), 0);
  EXPECT_EQ(last["missed_left"], 0);
}

TEST(GranaryctlScene, MeterEndsOnCtrlCWithTheShellsStatus) {
  const CtlFolder folder;
  const ProgramRun run = folder.Run(Demo("meter --every 0"), "timeout --preserve-status -s INT 3");
  EXPECT_EQ(run.exit_code, 130) << run.err;
}

TEST(GranaryctlScene, FindsTheOffsetThatMakesTheKnownVolume) {
  const CtlFolder folder;
  // As if the simulator's grain, smooth as it is, held 0.1 litre less than it shows: 0.5 mm over its floor.
  const ProgramRun run = folder.Run(Demo("grain-offset --volume 0.0192 --json"));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto found = run.Document();
  const double covered_m2 = found["covered_m2"].get<double>();
  EXPECT_NEAR(found["surface_offset_m"].get<double>(), 0.0001 / covered_m2, 0.0001);  // u95 of the box: 0.1 mm
  EXPECT_GT(found["surface_offset_u95_m"].get<double>(), 0);
  EXPECT_THAT(run.err, HasSubstr("surface_offset_m = "));
}

TEST(GranaryctlScene, AVolumeThatIsFarOffIsNoReliefOfGrain) {
  const CtlFolder folder;
  const ProgramRun run = folder.Run(Demo("grain-offset --volume 0.1"));
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.err, HasSubstr("is no relief of grain"));
  EXPECT_EQ(folder.Run(Demo("grain-offset --volume 0")).exit_code, 2);
}

TEST(GranaryctlScene, PrintsTheBudgetOnRequest) {
  const CtlFolder folder;
  const ProgramRun run = folder.Run(Demo("measure --budget"));
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, AllOf(HasSubstr("matching"), HasSubstr("completion"), HasSubstr("error rate, points")));
}

TEST(GranaryctlScene, ADamagedReferenceIsNotMeasuredAgainst) {
  const CtlFolder folder;
  ASSERT_EQ(folder.Run(Demo("reference --json")).exit_code, 0);
  const std::string text = TemporaryFolder::Read(folder / "state/reference/bin1/a/reference.json");
  const std::string id = nlohmann::json::parse(text)["id"];
  std::filesystem::resize_file(folder / ("state/reference/bin1/a/" + id + "/reference.pcd"), 1000);
  const ProgramRun run = folder.Run(Demo("measure --json"));
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.Document().value("error", ""), HasSubstr("reference.pcd"));
}

TEST(GranaryctlScene, SweepsTheSimulatedBin) {
  const CtlFolder folder;
  const ProgramRun run = folder.Run(Demo("sweep --json --repeats 3 --volume 0.0193 -o study"));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto table = run.Document();
  EXPECT_EQ(table["repeats"], 3);
  EXPECT_EQ(table["simulated"], true);
  ASSERT_EQ(table["thresholds"].size(), 31U);
  const auto& last = table["thresholds"][30];
  EXPECT_NEAR(last["volume_mean_m3"].get<double>(), kTruth_m3, kTolerance_m3);
  EXPECT_GT(last["rsd_percent"].get<double>(), 0) << "every measurement had the same noise";
  EXPECT_LT(last["rsd_percent"].get<double>(), 0.6);  // the paper's bound
  ASSERT_FALSE(table["plateau"].is_null()) << run.err;
  EXPECT_NEAR(table["plateau"]["volume_m3"].get<double>(), kTruth_m3, kTolerance_m3);
  EXPECT_THAT(run.err, AllOf(HasSubstr("stands still"), HasSubstr("stable from"), HasSubstr("the automatic rule")));
  EXPECT_FALSE(ReadImage(folder / "study/sweep.png").empty());
  EXPECT_GT(std::filesystem::file_size(folder / "study/sweep.csv"), 1000U);
}

TEST(GranaryctlScene, SweepsFilesAndMeasuresEachPairOnce) {
  const CtlFolder folder;
  ASSERT_EQ(folder.Run(Demo("reference")).exit_code, 0);
  ASSERT_EQ(folder.Run(Demo("snapshot -o shots")).exit_code, 0);
  const auto measured = folder.Run(Demo("measure --json --frames shots/left.png shots/right.png")).Document();
  const ProgramRun run =
      folder.Run(Demo("sweep --json --repeats 5 --from 0.004 --to 0.006 --step 0.0005 --frames shots/left.png "
                      "shots/right.png"));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto table = run.Document();
  EXPECT_EQ(table["repeats"], 1);
  EXPECT_TRUE(table["thresholds"][0]["rsd_percent"].is_null());
  EXPECT_EQ(table["automatic"]["volume_m3"], measured["volume_m3"]);
  EXPECT_THAT(run.err, HasSubstr("the files make 1"));
  EXPECT_TRUE(std::filesystem::exists(folder / "sweep.png"));

  // Without gnuplot the table is kept.
  std::filesystem::remove(folder / "sweep.png");
  std::filesystem::remove(folder / "sweep.csv");
  const ProgramRun bare = folder.Run(Demo("sweep --json --frames shots/left.png shots/right.png"), "PATH=/nowhere");
  EXPECT_EQ(bare.exit_code, 1);
  EXPECT_THAT(bare.Document().value("error", ""), AllOf(HasSubstr("sweep.png is missing"), HasSubstr("gnuplot-nox")));
  EXPECT_TRUE(std::filesystem::exists(folder / "sweep.csv"));
  EXPECT_FALSE(std::filesystem::exists(folder / "sweep.png"));
}

}  // namespace
}  // namespace granary
