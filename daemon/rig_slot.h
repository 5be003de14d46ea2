// The place of one rig in a worker: opened when needed, torn down on trouble, reopened with growing delay.
#pragma once

#include <chrono>
#include <functional>
#include <mutex>
#include <optional>
#include <string>

#include "daemon/clock.h"
#include "drivers/errors.h"
#include "drivers/options.h"
#include "drivers/rig.h"

namespace granary {

/// A rig and the world it stands in.
struct RigPlan {
  RigOptions options;
  RigWorld world;
};

using RigOpener = std::function<Rig(const RigOptions&, const RigWorld&)>;

/// Pause before the attempt after `failures` failures in a row: 1 s, 2 s, 4 s … 30 s; none before the first. So a
/// device is used again within a minute of being back.
[[nodiscard]] std::chrono::seconds ReopenDelay(int failures);

/// Used by the worker's thread, but for Interrupt.
class RigSlot {
 public:
  RigSlot(RigPlan plan, RigOpener open, Clock& clock);

  /// Opens the rig when it is closed and its delay is over, then captures one pair. On any trouble the rig is closed,
  /// with the projector off. Never waits for the delay: until it is over, the trouble is thrown again.
  /// @throws DeviceError naming the rig's device
  [[nodiscard]] FramePair Capture();
  /// Opens the rig unless it is open; what is wrong with it is known from then on, and its projector is off.
  /// @throws DeviceError naming the rig's device
  void Open();
  /// Between cycles: opens a closed rig whose delay is over. @return true when the rig is open now and was not before
  bool ReopenIfDue();
  /// Lets go of the devices.
  void Close() noexcept;
  /// Ends a Capture that blocks in the worker's thread. Any thread.
  void Interrupt() noexcept;

  /// Of all the rigs that stood in this place, together.
  [[nodiscard]] RigCounters counters() const;
  /// How often a rig was opened after trouble.
  [[nodiscard]] std::uint64_t reopened() const { return reopened_; }

  [[nodiscard]] const RigOptions& options() const { return plan_.options; }
  /// The trouble that closed the rig; empty while all is well.
  [[nodiscard]] const std::string& trouble() const { return trouble_; }

 private:
  void Fail(Reason reason, const std::string& words);

  RigPlan plan_;
  RigOpener open_;
  Clock& clock_;
  std::mutex mutex_;  // guards the rig's existence: written by the worker, read by Interrupt
  std::optional<Rig> rig_;
  RigCounters closed_counters_;
  std::uint64_t reopened_ = 0;
  int failures_ = 0;  // in a row, ended by a pair captured
  std::chrono::steady_clock::time_point not_before_{};
  Reason reason_ = Reason::kOk;
  std::string trouble_;
};

}  // namespace granary
