// granaryctl sweep: the paper's study of the edge limit. Each repeat is measured once, with the automatic limit; its
// triangles then give the volume at every threshold.
#include <CLI/CLI.hpp>

#include <cmath>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "daemon/ctl/command.h"
#include "daemon/ctl/gnuplot.h"
#include "daemon/ctl/run.h"
#include "daemon/ctl/setup.h"
#include "daemon/ctl/sweep_plot.h"
#include "daemon/ctl/sweep_table.h"
#include "pipeline/edge_sweep.h"
#include "pipeline/file_bytes.h"

namespace granary {
namespace {

constexpr int kUsualRepeats = 10;  // as in the paper

struct SweepArguments {
  double from_m = 0.0025, to_m = 0.0055, step_m = 0.0001;
  std::optional<int> repeats;
  std::optional<double> volume_m3;
  FrameFiles files;
  std::string rig;
  std::string folder = ".";
};

/// Each repeat is a shot: one pair a rig.
std::vector<Shot> TakeRepeats(ChosenBin bin, const FrameFiles& files, std::optional<int> wanted) {
  if (files.frames.empty()) {
    bin.config.shots = wanted.value_or(kUsualRepeats);
    for (ChosenRig& rig : bin.rigs) {
      if (!rig.Simulated() || rig.options.sim.motion == SimMotion::kStill) continue;
      Say("rig " + rig.options.name + ": the simulated grain stands still for the sweep");
      rig.options.sim.motion = SimMotion::kStill;
    }
    return TakeShots(bin, files);
  }
  std::vector<Shot> shots = TakeShots(bin, files);
  const auto given = static_cast<int>(shots.size());
  if (wanted && *wanted > given) {
    Say("--repeats " + std::to_string(*wanted) + ": the files make " + std::to_string(given) +
        "; each is measured once, since the same pictures give the same volume");
  }
  if (wanted && *wanted < given) {
    Say("--repeats " + std::to_string(*wanted) + ": of the " + std::to_string(given) +
        " that the files make, the first");
    shots.resize(static_cast<std::size_t>(*wanted));
  }
  return shots;
}

SweepRepeat SweepRun(const PipelineRun& run, const std::vector<double>& thresholds_m) {
  return {SweepEdgeLimits(run.surface, thresholds_m), run.surface.edge_threshold_m, run.measurement.volume_m3.value()};
}

/// The table is kept when the plot cannot be drawn.
void Save(const SweepTable& table, const std::filesystem::path& folder) {
  MakeFolder(folder);
  WriteBytes(folder / "sweep.csv", SweepCsv(table));
  try {
    DrawPlot(SweepPlotScript(table), folder / "sweep.png");
  } catch (const std::runtime_error& failure) {
    throw std::runtime_error("sweep.csv is in " + folder.string() + ", sweep.png is missing: " + failure.what());
  }
  Say("sweep.csv and sweep.png are in " + folder.string());
}

int Sweep(const GlobalOptions& global, const SweepArguments& arguments) {
  const auto thresholds_m = SweepThresholds(arguments.from_m, arguments.to_m, arguments.step_m);
  if (arguments.repeats && *arguments.repeats < 1) throw UsageError("--repeats: at least 1 is wanted");
  if (arguments.volume_m3 && !(*arguments.volume_m3 > 0 && std::isfinite(*arguments.volume_m3))) {
    throw UsageError("--volume: the true volume in m³, larger than 0, is wanted");
  }
  ChosenBin bin = ChooseBin(global, arguments.rig);
  bin.config.pipeline.surface.edge_threshold_m.reset();
  const std::vector<Shot> shots = TakeRepeats(bin, arguments.files, arguments.repeats);

  const Pipeline pipeline = PipelineOf(bin, !arguments.files.frames.empty());

  std::vector<SweepRepeat> repeats;
  UtcTime utc{};
  bool simulated = false;
  for (std::size_t i = 0; i < shots.size(); ++i) {
    const PipelineRun run = pipeline.Run(shots[i], bin.config.inventory);
    const Measurement& m = run.measurement;
    const std::string which = "measurement " + std::to_string(i + 1) + " of " + std::to_string(shots.size());
    if (!m.valid) throw std::runtime_error(which + ": " + std::string(InfoOf(m.reason).name) + ": " + m.detail);
    Say(which + (m.simulated ? " (simulated)" : ""));
    if (i == 0) utc = m.utc;
    simulated = simulated || m.simulated;
    repeats.push_back(SweepRun(run, thresholds_m));
  }

  SweepTable table = MakeSweepTable(repeats, GrainFloor_m2(bin.config.bin), arguments.volume_m3);
  table.bin = bin.config.bin.id;
  table.bin_name = bin.config.bin.name;
  table.utc = utc;
  table.simulated = simulated;
  Say(SweepText(table));
  Save(table, arguments.folder);
  if (global.json) PrintJson(SweepJson(table));
  return kExitDone;
}

}  // namespace

void AddSweep(CLI::App& app, const GlobalOptions& global, Command& chosen) {
  const auto arguments = std::make_shared<SweepArguments>();
  CLI::App* command = app.add_subcommand("sweep", "the volume against the longest edge of a triangle: table and plot");
  command->add_option("--from", arguments->from_m, "first threshold, metres")->capture_default_str()->type_name("M");
  command->add_option("--to", arguments->to_m, "last threshold, metres")->capture_default_str()->type_name("M");
  command->add_option("--step", arguments->step_m, "from one to the next, metres")
      ->capture_default_str()
      ->type_name("M");
  command->add_option("--repeats", arguments->repeats, "measurements; 10 with the cameras, with files all pairs given")
      ->type_name("N");
  command->add_option("--volume", arguments->volume_m3, "true volume, m3: errors are shown")->type_name("M3");
  AddFrameOptions(*command, arguments->files, arguments->rig, "once a repeat");
  command->add_option("-o,--out", arguments->folder, "folder for sweep.csv and sweep.png, made when absent")
      ->capture_default_str()
      ->type_name("DIR");
  command->callback([=, &global, &chosen] { chosen = [=, &global] { return Sweep(global, *arguments); }; });
}

}  // namespace granary
