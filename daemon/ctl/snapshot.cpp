// granaryctl snapshot: one pair from the rig, as files that every other command takes with --frames.
#include <CLI/CLI.hpp>

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "daemon/ctl/command.h"
#include "daemon/ctl/setup.h"
#include "daemon/record_json.h"
#include "pipeline/file_bytes.h"
#include "pipeline/frame_file.h"

namespace granary {
namespace {

struct SnapshotArguments {
  std::string rig;
  std::string folder;
};

std::optional<double> Count(const std::optional<std::chrono::microseconds>& duration) {
  return duration ? std::optional(static_cast<double>(duration->count())) : std::nullopt;
}

int Snapshot(const GlobalOptions& global, const SnapshotArguments& arguments) {
  const ChosenBin bin = ChooseBin(global, arguments.rig);
  const ChosenRig& rig = OnlyRig(bin);
  const std::filesystem::path folder = arguments.folder;
  MakeFolder(folder);
  const FramePair pair = CapturePair(bin, rig, false);
  SaveFrame(folder / "left.png", pair.left.image);
  SaveFrame(folder / "right.png", pair.right.image);
  if (pair.ambient_left) SaveFrame(folder / "ambient_left.png", pair.ambient_left->image);
  if (pair.ambient_right) SaveFrame(folder / "ambient_right.png", pair.ambient_right->image);
  Say("left.png and right.png are in " + folder.string() +
      (pair.ambient_left ? ", with ambient_left.png and ambient_right.png" : ""));
  if (global.json) {
    PrintJson({{"left", (folder / "left.png").string()},
               {"right", (folder / "right.png").string()},
               {"utc", UtcText(pair.left.exposure_start)},
               {"skew_us", OrNull(Count(pair.skew))},
               {"pulse_us", OrNull(Count(pair.pulse))},
               {"ambient", pair.ambient_left.has_value()},
               {"frame_ids", {pair.left.frame_id, pair.right.frame_id}},
               {"temperature_c", {OrNull(pair.left.temperature_c), OrNull(pair.right.temperature_c)}},
               {"bit_depth", pair.left.bit_depth},
               {"simulated", pair.Simulated()}});
  }
  return kExitDone;
}

}  // namespace

void AddSnapshot(CLI::App& app, const GlobalOptions& global, Command& chosen) {
  const auto arguments = std::make_shared<SnapshotArguments>();
  CLI::App* command = app.add_subcommand("snapshot", "save one pair from the rig as left.png and right.png");
  command->add_option("-o,--out", arguments->folder, "folder, made when absent")->required()->type_name("DIR");
  command->add_option("--rig", arguments->rig, "from this rig")->type_name("NAME");
  command->callback([=, &global, &chosen] { chosen = [=, &global] { return Snapshot(global, *arguments); }; });
}

}  // namespace granary
