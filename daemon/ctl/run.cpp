// References come before the frames: what is wrong with them should not cost a shot.
#include "daemon/ctl/run.h"

#include <CLI/CLI.hpp>

#include <string>
#include <utility>
#include <vector>

#include "daemon/memory.h"

namespace granary {

void AddFrameOptions(CLI::App& command, FrameFiles& files, std::string& rig, const std::string& how_often) {
  command
      .add_option("--frames", files.frames, "left and right picture of each rig, in place of its cameras; " + how_often)
      ->type_name("L R");
  command.add_option("--ambient", files.ambient, "the same with the projector off")->type_name("L R");
  command.add_option("--rig", rig, "measure with this rig only")->type_name("NAME");
}

Pipeline PipelineOf(const ChosenBin& bin, bool from_files) {
  std::vector<RigSetup> setups = bin.Setups();
  for (std::size_t i = 0; i < setups.size(); ++i) setups[i].reference = ReferenceFor(bin, i, from_files);
  Pipeline pipeline(bin.config.bin, std::move(setups), bin.config.pipeline);
  for (const std::string& note : pipeline.Notes()) Say(note);
  return pipeline;
}

PipelineRun MeasureBin(const ChosenBin& bin, const FrameFiles& files) {
  const Pipeline pipeline = PipelineOf(bin, !files.frames.empty());
  const double start_ms = SteadyMilliseconds();
  const std::vector<Shot> shots = TakeShots(bin, files);
  const double capture_ms = SteadyMilliseconds() - start_ms;
  PipelineRun run = pipeline.RunShots(shots, bin.config.inventory, SteadyMilliseconds);
  run.measurement.timings_ms.capture = capture_ms;
  run.measurement.timings_ms.total += capture_ms;
  run.measurement.peak_rss_mib = PeakRss_mib();
  return run;
}

}  // namespace granary
