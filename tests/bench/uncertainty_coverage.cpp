// Does the true volume lie within the stated uncertainty? The pictures are rendered with the true cameras; reference
// and grain are measured with calibrations of simulated boards, as a depot would have them. Usage: uncertainty_coverage
// [--calibrations N] [--seeds N] [--found-pose]
//        uncertainty_coverage --modes [--calibrations N]
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <string>
#include <vector>

#include <opencv2/calib3d.hpp>

#include "tests/bench/calibration_modes.h"
#include "tests/bench/machine.h"
#include "tests/pipeline/simulated_boards.h"
#include "tests/scene/simulated_bin.h"

namespace granary {
namespace {

struct Shape {
  SimShape shape;
  const char* name;
};
constexpr Shape kShapes[] = {
    {SimShape::kFlat, "flat"},     {SimShape::kTiltedLeft, "tilted left"}, {SimShape::kTiltedRight, "tilted right"},
    {SimShape::kConvex, "convex"}, {SimShape::kConcave, "concave"},        {SimShape::kPartial, "partial"}};

struct Scene {
  const char* shape;
  FramePair pair;
  double truth_m3;
};

std::vector<Scene> RenderShots(const RigWorld& world, int seeds) {
  std::vector<Scene> out;
  for (const Shape& shape : kShapes) {
    for (int seed = 1; seed <= seeds; ++seed) {
      SimOptions options;
      options.shape = shape.shape;
      options.seed = seed;
      SimScene scene(options, world);
      out.push_back({shape.name, scene.Render(seed), scene.TruthVolume_m3()});
    }
  }
  return out;
}

FramePair RenderEmpty(RigWorld world, int seed) {
  world.empty_bin = true;
  SimOptions options;
  options.seed = 1000 + seed;
  return SimScene(options, world).Render(0);
}

/// Errors and stated uncertainties, % of the truth.
struct Tally {
  int inside = 0, invalid = 0;
  double worst = 0, largest_u95 = 0;
  std::vector<double> errors;

  void Add(const Measurement& m, double truth_m3) {
    if (!m.valid) {
      ++invalid;
      return;
    }
    const double error = 100 * (*m.volume_m3 / truth_m3 - 1), u95 = 100 * *m.volume_u95_m3 / truth_m3;
    errors.push_back(error);
    inside += std::abs(error) <= u95;
    worst = std::max(worst, std::abs(error));
    largest_u95 = std::max(largest_u95, u95);
  }
  void Add(const Tally& other) {
    inside += other.inside;
    invalid += other.invalid;
    worst = std::max(worst, other.worst);
    largest_u95 = std::max(largest_u95, other.largest_u95);
    errors.insert(errors.end(), other.errors.begin(), other.errors.end());
  }
  [[nodiscard]] double Mean() const {
    double total = 0;
    for (const double e : errors) total += e;
    return total / static_cast<double>(errors.size());
  }
  [[nodiscard]] double InsidePercent() const { return 100.0 * inside / static_cast<double>(errors.size()); }
};

void PrintRow(const std::string& name, const Tally& stored, const Tally& plain) {
  std::printf("%-12s %+9.3f %9.3f %10.1f %9.3f %12.1f %9.3f %8d\n", name.c_str(), stored.Mean(), stored.worst,
              stored.InsidePercent(), stored.largest_u95, plain.InsidePercent(), plain.largest_u95, stored.invalid);
  std::fflush(stdout);
}

void MeasureCoverage(const RigWorld& world, int calibrations, int seeds, bool found_pose) {
  const std::vector<Scene> shots = RenderShots(world, seeds);
  std::printf("errors and u95 in %% of the true volume; %zu pictures a calibration; pose %s\n", shots.size(),
              found_pose ? "found with the calibration" : "true");
  std::printf("%-12s %9s %9s %20s %22s %8s\n", "", "", "", "stored covariance", "without covariance", "");
  std::printf("%-12s %9s %9s %10s %9s %12s %9s %8s\n", "calibration", "mean", "worst", "inside %", "max u95",
              "inside %", "max u95", "invalid");
  Tally all_stored, all_plain;
  std::vector<Tally> by_shape(std::size(kShapes)), by_shape_plain(std::size(kShapes));
  for (int i = 0; i < calibrations; ++i) {
    const BoardViews boards = SimulatedBoards(world.calibration, 16, 3000 + i);
    RigSetup rig{"a", CalibrateBoards(Noisy(boards, 0.1, 4000 + i), world.calibration), world.world_from_left, {}};
    if (found_pose)
      rig.world_from_left = FoundPose(world.bin, world.calibration, world.world_from_left, rig.calibration);
    const auto empty = Pipeline(world.bin, {rig}, {}).TakeReference(0, RenderEmpty(world, i));
    if (!empty.reference) {
      std::printf("calibration %d: no reference: %s\n", i + 1, empty.detail.c_str());
      continue;
    }
    rig.reference = empty.reference;
    const Pipeline with(world.bin, {rig}, {});
    rig.calibration.covariance.release();
    const Pipeline without(world.bin, {rig}, {});
    Tally stored, plain;
    for (std::size_t k = 0; k < shots.size(); ++k) {
      const Scene& shot = shots[k];
      const Measurement m = with.Run({shot.pair}, {}).measurement, n = without.Run({shot.pair}, {}).measurement;
      stored.Add(m, shot.truth_m3);
      plain.Add(n, shot.truth_m3);
      by_shape[k / seeds].Add(m, shot.truth_m3);
      by_shape_plain[k / seeds].Add(n, shot.truth_m3);
    }
    PrintRow(std::to_string(i + 1), stored, plain);
    all_stored.Add(stored);
    all_plain.Add(plain);
  }
  for (std::size_t s = 0; s < by_shape.size(); ++s) PrintRow(kShapes[s].name, by_shape[s], by_shape_plain[s]);
  PrintRow("all", all_stored, all_plain);
}

int Run(int argc, char** argv) {
  int calibrations = 10, seeds = 1;
  bool modes = false, found_pose = false;
  for (int i = 1; i < argc; ++i) {
    const auto number = [&] { return i + 1 < argc ? std::atoi(argv[++i]) : 0; };
    if (std::strcmp(argv[i], "--calibrations") == 0) {
      calibrations = number();
    } else if (std::strcmp(argv[i], "--seeds") == 0) {
      seeds = number();
    } else if (std::strcmp(argv[i], "--modes") == 0) {
      modes = true;
    } else if (std::strcmp(argv[i], "--found-pose") == 0) {
      found_pose = true;
    } else {
      calibrations = 0;
    }
  }
  if (calibrations < 1 || seeds < 1) {
    std::fprintf(stderr, "usage: %s [--modes] [--calibrations N] [--seeds N] [--found-pose], N at least 1\n", argv[0]);
    return 2;
  }
  const RigWorld world = SimulatedLab();
  if (modes) {
    PrintCalibrationModes(world, calibrations);
  } else {
    MeasureCoverage(world, calibrations, seeds, found_pose);
  }
  PrintMachine(argc, argv);
  return 0;
}

}  // namespace
}  // namespace granary

int main(int argc, char** argv) { return granary::Run(argc, argv); }
