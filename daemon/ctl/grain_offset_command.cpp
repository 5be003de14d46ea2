// granaryctl grain-offset: one fill of known volume gives the grain's surface offset for the configuration.
#include <CLI/CLI.hpp>

#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>

#include "daemon/ctl/command.h"
#include "daemon/ctl/grain_offset.h"
#include "daemon/ctl/run.h"
#include "pipeline/types/bin.h"

namespace granary {
namespace {

struct OffsetArguments {
  FrameFiles files;
  double volume_m3 = 0;
  double volume_u95_m3 = 0;
  std::string rig;
};

constexpr double kLeastCover = 0.5;  // less of the floor under grain makes every error of the volume a large offset

int FindOffset(const GlobalOptions& global, const OffsetArguments& arguments) {
  if (!(arguments.volume_m3 > 0)) throw UsageError("--volume: must be more than 0 m³");
  if (!(arguments.volume_u95_m3 >= 0)) throw UsageError("--volume-u95: must be 0 m³ or more");
  ChosenBin bin = ChooseBin(global, arguments.rig);
  bin.config.bin.grain.surface_offset_m.reset();
  bin.config.bin.grain.surface_offset_u95_m.reset();
  const PipelineRun run = MeasureBin(bin, arguments.files);
  const Measurement& m = run.measurement;
  if (!m.valid) {
    throw std::runtime_error("no volume was measured: " + std::string(InfoOf(m.reason).name) + ": " + m.detail);
  }
  char text[300];
  const double cover = run.relief_area_m2 / GrainFloor_m2(bin.config.bin);
  if (cover < kLeastCover) {
    std::snprintf(text, sizeof text, "grain covers %.0f %% of the floor, at least %.0f %% is wanted", 100 * cover,
                  100 * kLeastCover);
    throw std::runtime_error(text);
  }
  const GrainOffset found =
      FindGrainOffset(*m.volume_m3, *m.budget, run.relief_area_m2, arguments.volume_m3, arguments.volume_u95_m3);
  std::snprintf(text, sizeof text, "measured %.6g m³ without an offset, known %.6g m³: %+.2f %%%s", *m.volume_m3,
                arguments.volume_m3, 100 * (*m.volume_m3 / arguments.volume_m3 - 1), m.simulated ? " (simulated)" : "");
  Say(text);
  std::snprintf(text, sizeof text, "[bin.grain]\nsurface_offset_m = %.6f\nsurface_offset_u95_m = %.6f", found.offset_m,
                found.u95_m);
  Say("Into the configuration:");
  if (global.json) {
    Say(text);
    PrintJson({{"bin", bin.config.bin.id},
               {"surface_offset_m", found.offset_m},
               {"surface_offset_u95_m", found.u95_m},
               {"volume_measured_m3", *m.volume_m3},
               {"volume_known_m3", arguments.volume_m3},
               {"covered_m2", run.relief_area_m2},
               {"simulated", m.simulated}});
  } else {
    std::printf("%s\n", text);
  }
  return kExitDone;
}

}  // namespace

void AddGrainOffset(CLI::App& app, const GlobalOptions& global, Command& chosen) {
  const auto arguments = std::make_shared<OffsetArguments>();
  CLI::App* command = app.add_subcommand("grain-offset", "find the grain's surface offset from one known fill");
  command->add_option("--volume", arguments->volume_m3, "true volume of the grain, m³")->required()->type_name("M3");
  command->add_option("--volume-u95", arguments->volume_u95_m3, "its expanded uncertainty, m³; 0 when not given")
      ->type_name("M3");
  AddFrameOptions(*command, arguments->files, arguments->rig, "several times for several shots");
  command->callback([=, &global, &chosen] { chosen = [=, &global] { return FindOffset(global, *arguments); }; });
}

}  // namespace granary
