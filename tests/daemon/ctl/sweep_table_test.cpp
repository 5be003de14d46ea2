// The table of the threshold study from made-up repeats: figures, and the forms they are read in.
#include "daemon/ctl/sweep_table.h"

#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "daemon/ctl/command.h"
#include "daemon/ctl/gnuplot.h"
#include "daemon/ctl/sweep_plot.h"
#include "pipeline/frame_file.h"
#include "tests/pipeline/temporary_folder.h"

namespace granary {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

/// Three thresholds; the volumes are those given, the covered floor half a square metre.
SweepRepeat Repeat(const std::vector<double>& volumes_m3) {
  SweepRepeat repeat;
  for (std::size_t i = 0; i < volumes_m3.size(); ++i) {
    EdgeSweepStep step;
    step.edge_threshold_m = 0.001 * static_cast<double>(i + 1);
    step.total_m3 = volumes_m3[i];
    step.measured_area_m2 = 0.5;
    repeat.steps.push_back(step);
  }
  repeat.automatic_threshold_m = 0.002;
  repeat.automatic_volume_m3 = 2;
  return repeat;
}
SweepTable TwoRepeats() {
  SweepTable table = MakeSweepTable({Repeat({1, 2, 2, 2}), Repeat({1.1, 2, 2.001, 2})}, 2.0, 2.0);
  table.bin = 7;
  table.bin_name = "bay";
  table.simulated = true;
  return table;
}
std::string Refusal(double from_m, double to_m, double step_m) {
  try {
    (void)SweepThresholds(from_m, to_m, step_m);
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

TEST(SweepThresholds, AreThePapersThirtyOne) {
  const auto thresholds_m = SweepThresholds(0.0025, 0.0055, 0.0001);
  ASSERT_EQ(thresholds_m.size(), 31U);
  EXPECT_EQ(thresholds_m[0], 0.0025);
  EXPECT_EQ(thresholds_m[6], 0.0031);  // not 0.0030999999999999995
  EXPECT_EQ(thresholds_m[30], 0.0055);
}
TEST(SweepThresholds, EndAtTheLastStepThatFits) {
  EXPECT_THAT(SweepThresholds(0.001, 0.0029, 0.001), ElementsAre(0.001, 0.002));
  EXPECT_THAT(SweepThresholds(0.001, 0.001, 0.001), ElementsAre(0.001));
}
TEST(SweepThresholds, RefuseWhatIsNoRange) {
  EXPECT_THAT(Refusal(0, 1, 0.1), HasSubstr("--from"));
  EXPECT_THAT(Refusal(-1, 1, 0.1), HasSubstr("--from"));
  EXPECT_THAT(Refusal(NAN, 1, 0.1), HasSubstr("--from"));
  EXPECT_THAT(Refusal(1, 0.5, 0.1), HasSubstr("--to"));
  EXPECT_THAT(Refusal(1, INFINITY, 0.1), HasSubstr("--to"));
  EXPECT_THAT(Refusal(1, 2, 0), HasSubstr("--step"));
  EXPECT_THAT(Refusal(1, 2, NAN), HasSubstr("--step"));
}
TEST(SweepThresholds, AThousandAreAllowedAndNoMore) {
  EXPECT_EQ(SweepThresholds(0.001, 1, 0.001).size(), 1000U);
  EXPECT_THAT(Refusal(0.001, 1.001, 0.001), AllOf(HasSubstr("1001 thresholds"), HasSubstr("at most 1000")));
}

TEST(MakeSweepTable, RowsHoldMeanScatterErrorAndCoverage) {
  const SweepTable table = TwoRepeats();
  ASSERT_EQ(table.rows.size(), 4U);
  const SweepRow& row = table.rows[0];
  EXPECT_EQ(row.edge_threshold_m, 0.001);
  EXPECT_THAT(row.volumes_m3, ElementsAre(1, 1.1));
  EXPECT_NEAR(row.volume_mean_m3, 1.05, 1e-12);
  EXPECT_NEAR(*row.rsd_percent, 100 * 0.1 / std::sqrt(2.0) / 1.05, 1e-9);
  EXPECT_NEAR(*row.error_percent, -47.5, 1e-9);
  EXPECT_NEAR(row.coverage_percent, 25, 1e-12);
  EXPECT_EQ(table.automatic_threshold_m, 0.002);
  EXPECT_EQ(table.automatic_volume_m3, 2);
}
TEST(MakeSweepTable, OneRepeatHasNoScatterAndAnUnknownTruthNoError) {
  const SweepTable table = MakeSweepTable({Repeat({1, 2, 3})}, 2.0, {});
  EXPECT_FALSE(table.rows[0].rsd_percent);
  EXPECT_FALSE(table.rows[0].error_percent);
  const auto json = SweepJson(table);
  EXPECT_TRUE(json["thresholds"][0]["rsd_percent"].is_null());
  EXPECT_TRUE(json["thresholds"][0]["error_percent"].is_null());
  EXPECT_TRUE(json["plateau"].is_null());
  EXPECT_THAT(SweepCsv(table), HasSubstr("\n0.001,1,,,25,1\n"));
  EXPECT_THAT(SweepText(table), AllOf(Not(HasSubstr("RSD")), Not(HasSubstr("error"))));
}
TEST(MakeSweepTable, RefusesRepeatsThatDoNotFit) {
  EXPECT_THROW((void)MakeSweepTable({}, 1, {}), std::invalid_argument);
  EXPECT_THROW((void)MakeSweepTable({Repeat({1, 2}), Repeat({1})}, 1, {}), std::invalid_argument);
}

TEST(PlateauSentence, NamesRangeVolumeAndSpread) {
  EXPECT_EQ(PlateauSentence(TwoRepeats()), "stable from 2.0 to 4.0 mm: 2.00017 m³, spread 0.025 %");
}
TEST(PlateauSentence, SaysWhyThereIsNone) {
  EXPECT_THAT(PlateauSentence(MakeSweepTable({Repeat({1, 2, 3})}, 1, {})), HasSubstr("no plateau: no 3 thresholds"));
  EXPECT_THAT(PlateauSentence(MakeSweepTable({Repeat({1, 1})}, 1, {})), HasSubstr("no plateau: at least 3"));
}

TEST(SweepText, HasARowAThresholdAndNamesTheAutomaticLimit) {
  const std::string text = SweepText(TwoRepeats());
  EXPECT_THAT(text, AllOf(HasSubstr("bin 7 (bay)"), HasSubstr("2 measurements (simulated)")));
  EXPECT_THAT(text, HasSubstr("         1.0     1.05000     -47.500      6.7344       25.00\n"));
  EXPECT_THAT(text, HasSubstr("the automatic rule takes 2.00 mm: 2 m³"));
}
TEST(SweepText, FineStepsAreToldApart) {
  SweepTable table = TwoRepeats();
  table.rows[1].edge_threshold_m = 0.00125;
  EXPECT_THAT(SweepText(table), HasSubstr(" 1.25 "));
}

TEST(SweepCsv, NamesUnitsInItsHeader) {
  const std::string csv = SweepCsv(TwoRepeats());
  EXPECT_THAT(csv, testing::StartsWith("edge_threshold_m,volume_mean_m3,rsd_percent,error_percent,coverage_percent,"
                                       "volume_1_m3,volume_2_m3\n"));
  EXPECT_THAT(csv, HasSubstr("\n0.002,2,0,0,25,2,2\n"));
}

TEST(SweepJson, HoldsEveryFigure) {
  const auto json = SweepJson(TwoRepeats());
  EXPECT_EQ(json["bin"], 7);
  EXPECT_EQ(json["repeats"], 2);
  EXPECT_EQ(json["simulated"], true);
  EXPECT_EQ(json["thresholds"].size(), 4U);
  EXPECT_EQ(json["thresholds"][2]["volumes_m3"][1], 2.001);
  EXPECT_EQ(json["plateau"]["from_m"], 0.002);
  EXPECT_EQ(json["plateau"]["to_m"], 0.004);
  EXPECT_EQ(json["automatic"]["edge_threshold_m"], 0.002);
}

TEST(SweepPlotScript, DrawsEveryKindOfTable) {
  const TemporaryFolder folder;
  for (const SweepTable& table :
       {TwoRepeats(), MakeSweepTable({Repeat({1, 2, 3})}, 2.0, {}), MakeSweepTable({Repeat({1, 1, 1})}, 2.0, 1.0),
        MakeSweepTable({Repeat({1})}, 2.0, {}), MakeSweepTable({Repeat({0, 0}), Repeat({0, 0})}, 2.0, {})}) {
    DrawPlot(SweepPlotScript(table), folder / "sweep.png");
    EXPECT_FALSE(ReadImage(folder / "sweep.png").empty());
    std::filesystem::remove(folder / "sweep.png");
  }
}
TEST(SweepPlotScript, ABinsNameCannotBreakOut) {
  SweepTable table = TwoRepeats();
  table.bin_name = "it's `ls` @home \"x\" {/=50 big}";
  const TemporaryFolder folder;
  DrawPlot(SweepPlotScript(table), folder / "sweep.png");
  EXPECT_FALSE(ReadImage(folder / "sweep.png").empty());
}

}  // namespace
}  // namespace granary
