// Is a worker getting on? What feeds systemd's watchdog and the heartbeat.
#pragma once

#include <atomic>
#include <chrono>

#include "daemon/cycle.h"

namespace granary {

/// Longest silence allowed after entering `state`: a worker that is quiet for longer hangs. kIdle is short however long
/// the schedule is, because an idle worker looks up every second.
[[nodiscard]] std::chrono::milliseconds DeadlineOf(CycleState state, const CycleOptions& options, std::size_t pairs);

/// A worker's promise to be heard of again. Any thread.
class Progress {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// "You hear from me before now + deadline"; replaces the promise before.
  void Promise(Time now, std::chrono::milliseconds deadline) { until_ = now + deadline; }
  /// There is nothing more to be heard of.
  void Rest() { until_ = Time::max(); }
  /// False from the moment the last promise is broken until the next one; true before the first.
  [[nodiscard]] bool Kept(Time now) const { return now <= until_.load(); }

 private:
  std::atomic<Time> until_{Time::max()};
};

}  // namespace granary
