// From the options of a bin to something that can measure: calibration, pose, reference, pipeline.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>
#include <vector>

#include "daemon/bin_monitor.h"
#include "daemon/options.h"
#include "drivers/options.h"
#include "pipeline/options.h"
#include "pipeline/types/bin.h"

namespace granary {

/// Reads calibration and pose; opens no device. The slow rest is the setup's `prepare`: references and pipeline.
///
/// A simulated rig without a fitting reference gets one: the simulator is shown empty, measured and stored. A real rig
/// without one is measured as the pipeline can. One whose reference is damaged or belongs to another calibration or
/// pose is not measured: every cycle gives that reason, and the other bins go on.
/// @param configuration the effective configuration as text, for the hash
/// @throws FileError for a calibration or pose; std::invalid_argument for a time zone that cannot be. `prepare` throws
///   std::invalid_argument for a rig or pipeline that cannot be, DeviceError when the simulator fails
[[nodiscard]] BinSetup AssembleBin(const BinConfig& options, const std::filesystem::path& state_folder,
                                   const RigOpener& open, std::string_view configuration);

}  // namespace granary
