// Filling and draining: the volume as a function of the number of measurements.
#pragma once

#include <cstdint>

#include "drivers/options.h"

namespace granary {

/// Volume at step `step` (0 is the first measurement). Filling stops at `full_m3`, draining at `empty_m3`; a cycle
/// fills from `options.volume_m3` to `full_m3`, drains to `empty_m3` and so on. A start beyond those marks is kept
/// as long as the motion leads further away from them.
[[nodiscard]] double VolumeAt_m3(const SimOptions& options, std::uint64_t step, double empty_m3, double full_m3);

}  // namespace granary
