// The paper's box on the simulator, measured end to end.
#pragma once

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "drivers/rig.h"
#include "drivers/sim/scene.h"
#include "pipeline/calibration_file.h"
#include "pipeline/pipeline.h"

namespace granary {

inline RigWorld SimulatedLab() {
  RigWorld world;
  world.bin.id = 1;
  world.bin.name = "lab";
  for (const auto& [x, y] : {std::pair{0.0, 0.0}, {0.52, 0.0}, {0.52, 0.355}, {0.0, 0.355}}) {
    world.bin.footprint_m.emplace_back(x, y);
  }
  world.bin.height_m = 0.285;
  const std::filesystem::path folder = GRANARY_SIM_FOLDER;
  world.calibration = LoadStereoCalibration(folder / "stereo.yml");
  world.world_from_left = LoadWorldFromLeft(folder / "world.yml");
  return world;
}

/// The pipeline at its one fixed setting, with the reference taken from the simulator's empty bin.
inline Pipeline CommissionedPipeline(const RigWorld& world, const SimOptions& options) {
  RigSetup rig{"a", world.calibration, world.world_from_left, {}};
  RigWorld empty = world;
  empty.empty_bin = true;
  SimOptions light = options;
  light.seed += 1000;  // another day, other noise
  const FramePair pair = SimScene(light, empty).Render(0);
  rig.reference = Pipeline(world.bin, {rig}, {}).TakeReference(0, pair).reference;
  return Pipeline(world.bin, {rig}, {});
}

/// Mean, worst and relative standard deviation of errors in percent.
struct ErrorStatistics {
  double mean_percent = 0, worst_percent = 0, rsd_percent = 0;
};

inline ErrorStatistics Summarise(const std::vector<double>& volumes_m3, double truth_m3) {
  ErrorStatistics out;
  double mean = 0;
  for (const double v : volumes_m3) {
    mean += v / static_cast<double>(volumes_m3.size());
    out.worst_percent = std::max(out.worst_percent, 100 * std::abs(v / truth_m3 - 1));
  }
  double square = 0;
  for (const double v : volumes_m3) square += (v - mean) * (v - mean);
  out.mean_percent = 100 * (mean / truth_m3 - 1);
  out.rsd_percent = 100 * std::sqrt(square / static_cast<double>(volumes_m3.size() - 1)) / mean;
  return out;
}

}  // namespace granary
