// All that is slow or may be refused happens here, before a running configuration is given up for a new one.
#include "daemon/assembly.h"

#include <spdlog/spdlog.h>

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "daemon/schedule.h"
#include "drivers/errors.h"
#include "pipeline/calibration_file.h"
#include "pipeline/file_bytes.h"
#include "pipeline/file_error.h"
#include "pipeline/pipeline.h"
#include "pipeline/reference_file.h"

namespace granary {
namespace {

bool IsSimulated(const RigOptions& rig) {
  return rig.left.driver == CameraDriver::kSim && rig.right.driver == CameraDriver::kSim;
}

/// FNV-1a, 32 bit, continued from `hash`.
std::uint32_t Fnv1a(std::string_view bytes, std::uint32_t hash) {
  for (const char byte : bytes) hash = (hash ^ static_cast<unsigned char>(byte)) * 16777619U;
  return hash;
}

double SteadyMilliseconds() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Why a bin is not measured at all.
struct Refusal {
  Reason reason = Reason::kOk;
  std::string detail;
};

/// The stored reference of a rig; empty when there is none. What is wrong with it goes to `refusal`.
std::optional<Reference> StoredReference(const std::filesystem::path& folder, const RigSetup& rig, Refusal& refusal) {
  if (!HasReference(folder)) return std::nullopt;
  try {
    Reference reference = LoadReference(folder);
    if (reference.rig_hash == HashOfRig(rig.calibration, rig.world_from_left)) return reference;
    refusal = {Reason::kReferenceMismatch,
               "rig " + rig.name + ": reference " + reference.id + " was taken with another calibration or pose"};
  } catch (const FileError& error) {
    refusal = {Reason::kReferenceMissing, error.what()};
  }
  return std::nullopt;
}

/// Shows the simulator empty and measures it.
Reference TakeSimulatedReference(const BinConfig& options, const std::vector<RigSetup>& setups, std::size_t index,
                                 RigPlan plan, const std::filesystem::path& folder, const RigOpener& open) {
  plan.world.empty_bin = true;
  Rig rig = open(plan.options, plan.world);
  const Pipeline pipeline(options.bin, setups, options.pipeline);
  auto run = pipeline.TakeReference(index, rig.CapturePair());
  const std::string name = "bin " + std::to_string(options.bin.id) + " rig " + plan.options.name;
  if (!run.reference) throw DeviceError(run.reason, name, "take the simulated reference", run.detail);
  try {
    SaveReference(*run.reference, folder);
    spdlog::info("{}: simulated: took the reference {} of the empty bin, stored in {}", name, run.reference->id,
                 folder.string());
  } catch (const FileError& error) {
    spdlog::error("{}: simulated: took the reference of the empty bin, but cannot store it: {}", name, error.what());
  }
  return std::move(*run.reference);
}

/// Reads or takes the references and builds the pipeline.
void PrepareBin(const BinConfig& options, const std::filesystem::path& state_folder, const RigOpener& open,
                std::vector<RigSetup> rigs, BinSetup& setup) {
  Refusal refusal;
  for (std::size_t i = 0; i < rigs.size(); ++i) {
    const auto folder = ReferenceFolder(state_folder, options.bin.id, rigs[i].name);
    Refusal fault;
    rigs[i].reference = StoredReference(folder, rigs[i], fault);
    if (!rigs[i].reference && IsSimulated(options.rigs[i])) {
      rigs[i].reference = TakeSimulatedReference(options, rigs, i, setup.rigs[i], folder, open);
    } else if (fault.reason != Reason::kOk) {
      refusal = fault;
    }
    if (rigs[i].reference) setup.configuration_hash = Fnv1a(rigs[i].reference->hash, setup.configuration_hash);
  }

  if (refusal.reason != Reason::kOk) {
    setup.measure = [refusal](const std::vector<Shot>&, const Inventory&) {
      Measurement verdict;
      verdict.reason = refusal.reason;
      verdict.detail = refusal.detail;
      return verdict;
    };
    return;
  }
  auto pipeline = std::make_shared<const Pipeline>(options.bin, std::move(rigs), options.pipeline);
  for (const auto& note : pipeline->Notes()) spdlog::warn("bin {} {}: {}", options.bin.id, options.bin.name, note);
  setup.measure = [pipeline](const std::vector<Shot>& shots, const Inventory& inventory) {
    return pipeline->RunShots(shots, inventory, SteadyMilliseconds).measurement;
  };
}

}  // namespace

BinSetup AssembleBin(const BinConfig& options, const std::filesystem::path& state_folder, const RigOpener& open,
                     std::string_view configuration) {
  BinSetup setup;
  setup.bin = options.bin;
  setup.schedule = options.schedule;
  setup.cycle = options.cycle;
  setup.shots = options.shots;
  setup.inventory = options.inventory;
  setup.book_source = options.book_source;
  setup.simulated = true;
  // Asked once here, so that an unknown time zone is refused now and not in the worker.
  static_cast<void>(FirstRun(options.schedule, UtcTime{}));

  setup.configuration_hash = Fnv1a(configuration, 2166136261U);
  std::vector<RigSetup> rigs;
  for (const auto& rig : options.rigs) {
    RigSetup& added = rigs.emplace_back();
    added.name = rig.name;
    added.calibration = LoadStereoCalibration(rig.calibration);
    added.world_from_left = LoadWorldFromLeft(rig.pose);
    setup.configuration_hash = Fnv1a(ReadBytes(rig.pose), Fnv1a(ReadBytes(rig.calibration), setup.configuration_hash));
    setup.rigs.push_back({rig, {options.bin, added.calibration, added.world_from_left, false}});
    setup.simulated = setup.simulated && IsSimulated(rig);
  }
  setup.prepare = [=](BinSetup& prepared) { PrepareBin(options, state_folder, open, rigs, prepared); };
  return setup;
}

}  // namespace granary
