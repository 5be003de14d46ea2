// Everything the daemon does for one bin, but the waiting: captures, cycles, what is published.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/clock.h"
#include "daemon/cycle.h"
#include "daemon/fault_log.h"
#include "daemon/options.h"
#include "daemon/progress.h"
#include "daemon/publisher.h"
#include "daemon/records.h"
#include "daemon/rig_slot.h"
#include "daemon/snapshot.h"

namespace granary {

/// One bin as the daemon runs it.
struct BinSetup {
  Bin bin;
  ScheduleOptions schedule;
  CycleOptions cycle;
  std::vector<RigPlan> rigs;
  int shots = 1;  ///< a measurement
  /// The pipeline over the shots of one measurement.
  std::function<Measurement(const std::vector<Shot>&)> measure;
  bool simulated = false;                ///< its frames come from the simulator
  std::uint32_t configuration_hash = 0;  ///< configuration + calibration + reference
};

/// One line for a person: "bin 1 bay-1: 0.01901 m³ ±0.00006, 15.02 t, error -1.2 % (ok), coverage 97 %, 0.9 s".
[[nodiscard]] std::string CycleLine(const Bin& bin, const Measurement& measurement);
/// The same for a cycle without a figure: the reason, and what is held instead.
[[nodiscard]] std::string FailureLine(const BinSnapshot& snapshot);

/// Used by the worker's thread, but for Supervise, Interrupt and Snapshot (any thread).
class BinMonitor {
 public:
  /// @param publishers borrowed; they outlive the monitor
  BinMonitor(BinSetup setup, Records& records, std::vector<Publisher*> publishers, Clock& clock, RigOpener open);

  /// Publishes what is known before the first cycle: the newest stored figure as held, with its own time.
  /// @param carried the snapshot of the monitor that this one replaces (same bin, new configuration)
  void Restore(const std::optional<BinSnapshot>& carried = std::nullopt);
  /// Opens the rigs before the first cycle, so that a line that a crash left high falls, and trouble is told now and not
  /// at the first scheduled time.
  void Open();
  /// One cycle. @return false when `stop` ended it
  bool RunCycle(const std::stop_token& stop);
  /// Between cycles: after one that failed at a camera or projector, tries from time to time (first after 5 s, at last
  /// every 30 s, and at once when a rig could be opened again) whether a measurement succeeds, and publishes it then.
  /// @return true when one was published
  bool TryAgain(const std::stop_token& stop);
  /// What there is to do between cycles, every second or so: reopens rigs, keeps the promise of progress.
  void Idle(std::optional<UtcTime> next_at);
  /// Lets go of the devices; the end of the worker, and no hang.
  void Close() noexcept;

  /// Called once a second by the supervising loop: while the worker makes progress the heartbeat goes on.
  /// @return false when the worker hangs
  bool Supervise();
  /// Ends a capture that blocks.
  void Interrupt() noexcept;
  [[nodiscard]] BinSnapshot Snapshot() const;
  [[nodiscard]] const BinSetup& setup() const { return setup_; }

 private:
  [[nodiscard]] bool Run(const std::stop_token& stop, CycleKind kind);
  [[nodiscard]] std::vector<Shot> Capture();
  void CountDevices(BinSnapshot& snapshot) const;
  void Finish(const Measurement& measurement);
  void Log(const BinSnapshot& snapshot);
  /// Changes the snapshot and publishes it as one step, so that publishers see the changes in order.
  void Update(const std::function<void(BinSnapshot&)>& change);

  BinSetup setup_;
  Records& records_;
  std::vector<Publisher*> publishers_;
  Clock& clock_;
  std::deque<RigSlot> slots_;  // never moved: they hold mutexes
  std::optional<Cycle> cycle_;
  Progress progress_;
  RigCounters carried_devices_;  // of the monitor before this one
  std::uint64_t carried_reopened_ = 0;
  int trials_ = 0;  // since the last scheduled cycle
  std::chrono::steady_clock::time_point try_at_{};
  FaultLog fault_log_;
  mutable std::mutex mutex_;  // guards snapshot_, and the order of Publish (which returns at once)
  BinSnapshot snapshot_;
};

}  // namespace granary
