// What the publishers know of one bin at one moment: a plain value, made by the worker, read by the servers.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "daemon/control.h"
#include "daemon/options.h"
#include "drivers/rig.h"
#include "pipeline/types/bin.h"
#include "pipeline/types/measurement.h"

namespace granary {

/// `good` is the figure that is published; `held` says that it is not from the last cycle.
struct BinSnapshot {
  Bin bin;
  std::optional<Measurement> good;  ///< newest valid measurement, restored after a restart
  std::optional<Measurement> last;  ///< newest cycle since start, valid or not
  bool held = false;                ///< the last cycle failed, or `good` was restored and nothing was measured since
  bool measuring = false;
  bool stale = false;  ///< `good` is older than stale_after
  bool maintenance = false;
  bool abnormal_latched = false;
  std::optional<double> rate_m3_h;    ///< change of volume between the last two valid measurements
  std::optional<double> change_m3;    ///< the same change as a volume; tells filling and emptying from noise
  Reason last_failure = Reason::kOk;  ///< of the newest failed cycle
  std::uint64_t cycles = 0, failures = 0;
  RigCounters devices;                   ///< of all the bin's rigs since the start
  std::uint64_t reopened = 0;            ///< rigs opened again after trouble
  std::uint16_t heartbeat = 0;           ///< +1 each second while the worker makes progress
  std::optional<UtcTime> next_at;        ///< next scheduled measurement
  std::uint32_t configuration_hash = 0;  ///< configuration + calibration + reference
  CommandState command;                  ///< handshake of registers 910–912
  BookState book;                        ///< what the next measurement is compared with
  RegisterFormat format;                 ///< how clients want registers 0–899 written out
  bool injected = false;                 ///< `good` and `last` were made up for a loop test; simulated is on, too
  std::uint32_t restarts = 0;  ///< starts of the daemon, but the first, since its records began; all bits: not known
};

}  // namespace granary
