// Path-traced bins of known volume, where they are at hand; skipped, saying so, where they are not.
#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <fstream>

#include <nlohmann/json.hpp>

#include "pipeline/calibration_file.h"
#include "pipeline/frame_file.h"
#include "pipeline/pipeline.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

Polygon Rectangle(double x0, double y0, double x1, double y1) {
  return {Eigen::Vector2d(x0, y0), Eigen::Vector2d(x1, y0), Eigen::Vector2d(x1, y1), Eigen::Vector2d(x0, y1)};
}

struct Sample {
  Measurement measurement;
  double low_m3 = 0, high_m3 = 0;  ///< the band in which the truth is defined
};

Sample MeasureSample(const fs::path& folder, double height_m) {
  const auto truth = nlohmann::json::parse(std::ifstream(folder / "truth.json"));
  const auto& container = truth.at("container");
  Bin bin;
  bin.footprint_m = Rectangle(0, 0, container.at("size_m").at(0), container.at("size_m").at(1));
  bin.height_m = height_m;
  if (container.contains("pillars_xyxy_m")) {
    for (const auto& p : container.at("pillars_xyxy_m")) bin.exclude_m.push_back(Rectangle(p[0], p[1], p[2], p[3]));
  }
  RigSetup rig{"a", LoadStereoCalibration(folder / "stereo.yml"), LoadWorldFromLeft(folder / "world.yml"), {}};
  const auto reference =
      Pipeline(bin, {rig}, {}).TakeReference(0, LoadFramePair(folder / "empty_left.png", folder / "empty_right.png"));
  EXPECT_EQ(reference.reason, Reason::kOk) << reference.detail;
  rig.reference = reference.reference;
  Sample out;
  out.measurement = Pipeline(bin, {rig}, {})
                        .Run({LoadFramePair(folder / "full_left.png", folder / "full_right.png")}, {})
                        .measurement;
  out.low_m3 = truth.at("volume_m3");
  out.high_m3 = truth.value("volume_closed_6mm_m3", out.low_m3);
  return out;
}

double PercentOutside(const Sample& sample) {
  const double volume = sample.measurement.volume_m3.value();
  if (volume < sample.low_m3) return 100 * (volume / sample.low_m3 - 1);
  if (volume > sample.high_m3) return 100 * (volume / sample.high_m3 - 1);
  return 0;
}

class Samples : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    folder_ = fs::path(GRANARY_SAMPLES) / GetParam();
    if (!fs::exists(folder_)) GTEST_SKIP() << folder_ << " is not here";
  }
  fs::path folder_;
};

class LabSamples : public Samples {};
TEST_P(LabSamples, VolumeLiesWithinHalfAPercentOfTheTruthBand) {
  const Sample sample = MeasureSample(folder_, 0.285);
  ASSERT_TRUE(sample.measurement.valid) << sample.measurement.detail;
  std::printf("%s: %+.3f %% of the kernels' envelope, %+.3f %% of a sheet over them\n", GetParam(),
              100 * (*sample.measurement.volume_m3 / sample.low_m3 - 1),
              100 * (*sample.measurement.volume_m3 / sample.high_m3 - 1));
  EXPECT_LT(std::abs(PercentOutside(sample)), 0.5);
}
INSTANTIATE_TEST_SUITE_P(Lab, LabSamples, testing::Values("lab_flat", "lab_left", "lab_partial"));

class WarehouseSamples : public Samples {};
TEST_P(WarehouseSamples, VolumeLiesWithinThreeTenthsOfAPercent) {
  const Sample sample = MeasureSample(folder_, 6.5);
  ASSERT_TRUE(sample.measurement.valid) << sample.measurement.detail;
  std::printf("%s: %+.3f %%\n", GetParam(), PercentOutside(sample));
  EXPECT_LT(std::abs(PercentOutside(sample)), 0.3);
}
INSTANTIATE_TEST_SUITE_P(Warehouse, WarehouseSamples, testing::Values("warehouse_dunes"));

}  // namespace
}  // namespace granary
