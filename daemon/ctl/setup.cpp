// The commands work on one bin: found here once, with everything that may be wrong about it said in one place.
#include "daemon/ctl/setup.h"

#include <algorithm>
#include <chrono>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/ctl/stop_signals.h"
#include "daemon/store.h"
#include "drivers/errors.h"
#include "drivers/rig.h"
#include "pipeline/calibration_file.h"
#include "pipeline/frame_file.h"
#include "pipeline/reference_file.h"

namespace granary {
namespace {

/// "1, 2, 3".
template <typename Items, typename Text>
std::string Listed(const Items& items, Text&& text) {
  std::string list;
  for (const auto& item : items) list += (list.empty() ? "" : ", ") + text(item);
  return list;
}

BinConfig PickBin(const Config& config, const std::optional<int>& id) {
  const std::string known = Listed(config.bins, [](const BinConfig& bin) { return std::to_string(bin.bin.id); });
  if (!id) {
    if (config.bins.size() == 1) return config.bins.front();
    throw UsageError("--bin is needed: " + config.file.string() + " has the bins " + known);
  }
  const auto found =
      std::find_if(config.bins.begin(), config.bins.end(), [&](const auto& bin) { return bin.bin.id == *id; });
  if (found == config.bins.end()) {
    throw UsageError("--bin " + std::to_string(*id) + ": " + config.file.string() + " has " +
                     (config.bins.size() == 1 ? "only bin " : "the bins ") + known);
  }
  return *found;
}

std::vector<RigOptions> PickRigs(const BinConfig& bin, const std::string& name) {
  if (name.empty()) return bin.rigs;
  const auto found = std::find_if(bin.rigs.begin(), bin.rigs.end(), [&](const auto& rig) { return rig.name == name; });
  if (found == bin.rigs.end()) {
    throw UsageError("--rig " + name + ": bin " + std::to_string(bin.bin.id) + " has " +
                     Listed(bin.rigs, [](const RigOptions& rig) { return rig.name; }));
  }
  return {*found};
}

/// What `capture` gives, with the attempts that the daemon has, too. It opens its rigs itself: one in trouble is not
/// used again.
template <typename Capture>
auto WithRetries(const CycleOptions& cycle, Capture&& capture) {
  for (int attempt = 1;; ++attempt) {
    try {
      return capture();
    } catch (const DeviceError& error) {
      if (attempt >= cycle.attempts || !IsFleeting(error.reason())) throw;
      Say(std::string(InfoOf(error.reason()).name) + ": " + error.what() + "; trying again");
    }
    std::this_thread::sleep_for(cycle.retry_delay);
  }
}

/// One shot after the other from rigs that are opened once: what comes between two shots should be as short as it can
/// be.
std::vector<Shot> CaptureShots(const ChosenBin& bin) {
  std::vector<Rig> rigs;
  for (const ChosenRig& rig : bin.rigs) rigs.push_back(OpenRig(rig.options, WorldOf(bin, rig)));
  std::vector<Shot> shots;
  for (int k = 0; k < bin.config.shots; ++k) {
    Shot& shot = shots.emplace_back();
    for (Rig& rig : rigs) {
      const CaptureGuard guard;
      shot.push_back(rig.CapturePair());
    }
  }
  return shots;
}

std::string Rigs(std::size_t count) { return std::to_string(count) + (count == 1 ? " rig" : " rigs"); }

}  // namespace

bool ChosenRig::Simulated() const {
  return options.left.driver == CameraDriver::kSim && options.right.driver == CameraDriver::kSim;
}

std::vector<RigSetup> ChosenBin::Setups() const {
  std::vector<RigSetup> setups;
  for (const ChosenRig& rig : rigs) setups.push_back(rig.setup);
  return setups;
}

const ChosenRig& OnlyRig(const ChosenBin& bin) {
  if (bin.rigs.size() == 1) return bin.rigs.front();
  throw UsageError("bin " + std::to_string(bin.config.bin.id) + " has several rigs; --rig NAME is needed");
}

RigWorld WorldOf(const ChosenBin& bin, const ChosenRig& rig, bool empty_bin) {
  return {bin.config.bin, rig.setup.calibration, rig.setup.world_from_left, empty_bin};
}

ChosenBin ChooseBin(const GlobalOptions& global, const std::string& rig) {
  ChosenBin chosen;
  chosen.config = PickBin(LoadConfig(global.config), global.bin);
  for (RigOptions& options : PickRigs(chosen.config, rig)) {
    ChosenRig& added = chosen.rigs.emplace_back();
    added.setup.name = options.name;
    added.setup.calibration = LoadStereoCalibration(options.calibration);
    added.setup.world_from_left = LoadWorldFromLeft(options.pose);
    added.options = std::move(options);
  }
  return chosen;
}

Shot LoadShot(const ChosenBin& bin, const FrameFiles& files) {
  Shot pairs;
  if (files.frames.size() != 2 * bin.rigs.size()) {
    throw UsageError("--frames: " + std::to_string(files.frames.size()) + " files for " + Rigs(bin.rigs.size()) +
                     "; left and right of each rig are wanted (--rig NAME picks one rig)");
  }
  if (!files.ambient.empty() && files.ambient.size() != files.frames.size()) {
    throw UsageError("--ambient: as many files as --frames are wanted");
  }
  const UtcTime now(std::chrono::system_clock::now());
  for (std::size_t i = 0; i < files.frames.size(); i += 2) {
    pairs.push_back(files.ambient.empty()
                        ? LoadFramePair(files.frames[i], files.frames[i + 1])
                        : LoadFramePair(files.frames[i], files.frames[i + 1], files.ambient[i], files.ambient[i + 1]));
    pairs.back().left.exposure_start = pairs.back().right.exposure_start = now;
  }
  return pairs;
}

std::vector<Shot> TakeShots(const ChosenBin& bin, const FrameFiles& files) {
  std::vector<Shot> shots;
  const std::size_t a_shot = 2 * bin.rigs.size();
  if (!files.frames.empty()) {
    if (files.frames.size() % a_shot != 0) {
      throw UsageError("--frames: " + std::to_string(files.frames.size()) + " files for " + Rigs(bin.rigs.size()) +
                       "; left and right of each rig are wanted, once or several times (--rig NAME picks one rig)");
    }
    if (!files.ambient.empty() && files.ambient.size() != files.frames.size()) {
      throw UsageError("--ambient: as many files as --frames are wanted");
    }
    for (std::size_t first = 0; first < files.frames.size(); first += a_shot) {
      const auto part = [&](const std::vector<std::filesystem::path>& all) {
        if (all.empty()) return all;
        const auto begin = all.begin() + static_cast<std::ptrdiff_t>(first);
        return std::vector(begin, begin + static_cast<std::ptrdiff_t>(a_shot));
      };
      shots.push_back(LoadShot(bin, {part(files.frames), part(files.ambient)}));
    }
    return shots;
  }
  if (!files.ambient.empty()) throw UsageError("--ambient goes with --frames");
  for (const ChosenRig& rig : bin.rigs) {
    Say("bin " + std::to_string(bin.config.bin.id) + ", rig " + rig.options.name + ": capturing " +
        (bin.config.shots == 1 ? "a pair" : std::to_string(bin.config.shots) + " pairs") +
        (rig.Simulated() ? " (simulated)" : ""));
  }
  return WithRetries(bin.config.cycle, [&] { return CaptureShots(bin); });
}

FramePair CapturePair(const ChosenBin& bin, const ChosenRig& rig, bool empty_bin) {
  Say("bin " + std::to_string(bin.config.bin.id) + ", rig " + rig.options.name + ": capturing a pair" +
      (rig.Simulated() ? empty_bin ? " (simulated, the bin without grain)" : " (simulated)" : ""));
  return WithRetries(bin.config.cycle, [&] {
    Rig opened = OpenRig(rig.options, WorldOf(bin, rig, empty_bin));
    const CaptureGuard guard;
    return opened.CapturePair();
  });
}

std::filesystem::path ReferenceFolderOf(const ChosenBin& bin, const ChosenRig& rig) {
  return ReferenceFolder(StateFolder(), bin.config.bin.id, rig.options.name);
}

std::optional<Reference> ReferenceFor(const ChosenBin& bin, std::size_t index, bool from_files) {
  const ChosenRig& rig = bin.rigs[index];
  const auto folder = ReferenceFolderOf(bin, rig);
  const bool simulator = rig.Simulated() && !from_files;
  if (HasReference(folder)) {
    Reference stored = LoadReference(folder);
    const bool fits = stored.rig_hash == HashOfRig(rig.setup.calibration, rig.setup.world_from_left);
    if (fits && stored.simulated && !simulator) {
      Say("rig " + rig.options.name + ": warning: reference " + stored.id + " is of the simulator, the frames are not");
    }
    if (fits) return stored;
    if (!simulator) {
      throw std::runtime_error("rig " + rig.options.name + ": reference " + stored.id + " in " + folder.string() +
                               " was taken with another calibration or pose; take it again");
    }
  }
  if (!simulator) return std::nullopt;
  Say("rig " + rig.options.name +
      ": no reference is stored; taking one of the simulator's empty bin, for this time only");
  const Pipeline pipeline(bin.config.bin, bin.Setups(), bin.config.pipeline);
  auto run = pipeline.TakeReference(index, CapturePair(bin, rig, true));
  if (!run.reference) {
    throw std::runtime_error("rig " + rig.options.name + ": no reference: " + std::string(InfoOf(run.reason).name) +
                             ": " + run.detail);
  }
  return std::move(run.reference);
}

double SteadyMilliseconds() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace granary
