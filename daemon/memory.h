// What this process takes of the machine's memory.
#pragma once

namespace granary {

/// Peak resident memory of this process, MiB.
[[nodiscard]] double PeakRss_mib();

}  // namespace granary
