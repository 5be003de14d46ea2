// References come before the frames: what is wrong with them should not cost a shot.
#include "daemon/ctl/run.h"

#include <string>
#include <utility>
#include <vector>

#include "daemon/memory.h"

namespace granary {

PipelineRun MeasureBin(const ChosenBin& bin, const FrameFiles& files) {
  std::vector<RigSetup> setups = bin.Setups();
  for (std::size_t i = 0; i < setups.size(); ++i) setups[i].reference = ReferenceFor(bin, i, !files.frames.empty());
  const double start_ms = SteadyMilliseconds();
  const std::vector<Shot> shots = TakeShots(bin, files);
  const double capture_ms = SteadyMilliseconds() - start_ms;

  const Pipeline pipeline(bin.config.bin, std::move(setups), bin.config.pipeline);
  for (const std::string& note : pipeline.Notes()) Say(note);
  PipelineRun run = pipeline.RunShots(shots, bin.config.inventory, SteadyMilliseconds);
  run.measurement.timings_ms.capture = capture_ms;
  run.measurement.timings_ms.total += capture_ms;
  run.measurement.peak_rss_mib = PeakRss_mib();
  return run;
}

}  // namespace granary
