// granaryctl reference: the empty bin's cloud, taken once at commissioning and stored in the state folder.
#include <CLI/CLI.hpp>

#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "daemon/ctl/command.h"
#include "daemon/ctl/setup.h"
#include "daemon/record_json.h"
#include "pipeline/reference_file.h"

namespace granary {
namespace {

struct ReferenceArguments {
  FrameFiles files;
  std::string rig;
};

using Json = nlohmann::ordered_json;

Json TakeOne(const ChosenBin& bin, std::size_t index, const FramePair& pair) {
  const ChosenRig& rig = bin.rigs[index];
  const std::string name = "bin " + std::to_string(bin.config.bin.id) + ", rig " + rig.options.name;
  const Pipeline pipeline(bin.config.bin, bin.Setups(), bin.config.pipeline);
  const auto run = pipeline.TakeReference(index, pair);
  if (!run.reference) {
    const ReasonInfo& reason = InfoOf(run.reason);
    throw std::runtime_error(name + ": the picture makes no reference: " + std::string(reason.name) + ": " +
                             run.detail);
  }
  const auto folder = ReferenceFolderOf(bin, rig);
  SaveReference(*run.reference, folder);
  char coverage[32];
  std::snprintf(coverage, sizeof coverage, "%.1f", run.coverage_percent);
  Say(name + ": reference " + run.reference->id + ", hash " + run.reference->hash + ", " + coverage +
      " % of the floor seen" + (run.reference->simulated ? " (simulated)" : "") + "\n  stored in " + folder.string());
  return {{"bin", bin.config.bin.id},
          {"rig", rig.options.name},
          {"id", run.reference->id},
          {"hash", run.reference->hash},
          {"rig_hash", run.reference->rig_hash},
          {"utc", UtcText(run.reference->utc)},
          {"simulated", run.reference->simulated},
          {"coverage_percent", run.coverage_percent},
          {"folder", folder.string()}};
}

int TakeReferences(const GlobalOptions& global, const ReferenceArguments& arguments) {
  const ChosenBin bin = ChooseBin(global, arguments.rig);
  Json taken = Json::array();
  if (arguments.files.frames.empty()) {
    for (std::size_t i = 0; i < bin.rigs.size(); ++i)
      taken.push_back(TakeOne(bin, i, CapturePair(bin, bin.rigs[i], true)));
  } else {
    static_cast<void>(OnlyRig(bin));  // one pair of files is of one rig
    if (arguments.files.frames.size() != 2) throw UsageError("--frames: one pair, left and right, is wanted");
    taken.push_back(TakeOne(bin, 0, LoadShot(bin, arguments.files).front()));
  }
  if (global.json) PrintJson(taken.size() == 1 ? taken.front() : taken);
  return kExitDone;
}

}  // namespace

void AddReference(CLI::App& app, const GlobalOptions& global, Command& chosen) {
  const auto arguments = std::make_shared<ReferenceArguments>();
  CLI::App* command = app.add_subcommand("reference", "take the empty bin's cloud and store it; the old one is kept");
  command->add_option("--frames", arguments->files.frames, "left and right picture, in place of the cameras")
      ->type_name("L R");
  command->add_option("--ambient", arguments->files.ambient, "the same with the projector off")->type_name("L R");
  command->add_option("--rig", arguments->rig, "of this rig only")->type_name("NAME");
  command->callback([=, &global, &chosen] { chosen = [=, &global] { return TakeReferences(global, *arguments); }; });
}

}  // namespace granary
