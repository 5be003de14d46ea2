// From the global options to bins, rigs and frames.
#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "config/config.h"
#include "daemon/ctl/command.h"
#include "drivers/rig.h"
#include "pipeline/pipeline.h"

namespace granary {

/// A rig of the chosen bin with its calibration and pose read.
struct ChosenRig {
  RigOptions options;
  RigSetup setup;  ///< without its reference
  [[nodiscard]] bool Simulated() const;
};

/// One bin of the configuration and the rigs asked for.
struct ChosenBin {
  BinConfig config;
  std::vector<ChosenRig> rigs;
  [[nodiscard]] std::vector<RigSetup> Setups() const;
};

/// For commands that look at one rig. @throws UsageError when there are several
[[nodiscard]] const ChosenRig& OnlyRig(const ChosenBin& bin);

/// What OpenRig has to know. @param empty_bin a simulated rig shows the bin without grain
[[nodiscard]] RigWorld WorldOf(const ChosenBin& bin, const ChosenRig& rig, bool empty_bin = false);

/// Reads the configuration, and calibration and pose of the rigs.
/// @param rig empty: all rigs of the bin
/// @throws ConfigError, FileError; UsageError when no bin, or no rig, or several bins, fit the options
[[nodiscard]] ChosenBin ChooseBin(const GlobalOptions& global, const std::string& rig);

/// `--frames` and `--ambient`: two files a rig, left before right.
struct FrameFiles {
  std::vector<std::filesystem::path> frames;
  std::vector<std::filesystem::path> ambient;  ///< as many, or none
};

/// One pair for each rig from files. They are given the time at which they are read, as a replay camera would: they do
/// not tell when they were taken.
/// @throws UsageError when the files do not fit the rigs; FileError
[[nodiscard]] Shot LoadShot(const ChosenBin& bin, const FrameFiles& files);

/// The shots of one measurement: as many as the files make (each a pair for each rig, shot after shot), else as many as
/// the configuration wants from the cameras. A capture that fails for the moment is tried again as the daemon does.
/// @throws UsageError when the files do not fit the rigs; FileError, DeviceError
[[nodiscard]] std::vector<Shot> TakeShots(const ChosenBin& bin, const FrameFiles& files);

/// One pair from the rig's own cameras, with the daemon's attempts. @param empty_bin a simulated rig shows the bin
/// without grain
[[nodiscard]] FramePair CapturePair(const ChosenBin& bin, const ChosenRig& rig, bool empty_bin);

/// Where the rig's reference is stored.
[[nodiscard]] std::filesystem::path ReferenceFolderOf(const ChosenBin& bin, const ChosenRig& rig);

/// What the grain of the bin's rig `index` is measured against: the stored reference; where none is stored, or one of
/// another rig, a simulated rig takes one of its empty bin, for this time only. Empty when there is nothing, and the
/// pipeline says what that costs.
/// @param from_files the frames come from files, not from the rig's own cameras
/// @throws std::runtime_error when the stored one is of another calibration or pose, or none can be taken; FileError,
///   DeviceError
[[nodiscard]] std::optional<Reference> ReferenceFor(const ChosenBin& bin, std::size_t index, bool from_files);

/// Milliseconds of a clock that only goes forward.
[[nodiscard]] double SteadyMilliseconds();

}  // namespace granary
