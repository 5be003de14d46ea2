// granaryctl snapshot: one pair from the rig, as files that every other command takes with --frames.
#include <CLI/CLI.hpp>

#include <filesystem>
#include <memory>
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

int Snapshot(const GlobalOptions& global, const SnapshotArguments& arguments) {
  const ChosenBin bin = ChooseBin(global, arguments.rig);
  if (bin.rigs.size() != 1) {
    throw UsageError("bin " + std::to_string(bin.config.bin.id) + " has several rigs; --rig NAME is needed");
  }
  const std::filesystem::path folder = arguments.folder;
  MakeFolder(folder);
  const FramePair pair = CapturePair(bin, bin.rigs.front(), false);
  SaveFrame(folder / "left.png", pair.left.image);
  SaveFrame(folder / "right.png", pair.right.image);
  Say("left.png and right.png are in " + folder.string());
  if (global.json) {
    PrintJson({{"left", (folder / "left.png").string()},
               {"right", (folder / "right.png").string()},
               {"utc", UtcText(pair.left.exposure_start)},
               {"skew_us", pair.skew ? nlohmann::ordered_json(pair.skew->count()) : nlohmann::ordered_json()},
               {"bit_depth", pair.left.bit_depth},
               {"simulated", pair.Simulated()}});
  }
  return kDone;
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
