// One thread a bin: waits for the schedule, runs cycles.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <thread>
#include <vector>

#include "daemon/bin_monitor.h"

namespace granary {

/// Owned by the main thread; everything inside the monitor but what it says otherwise belongs to the worker's thread.
class Worker {
 public:
  /// @param on_cycle called from the worker's thread after each cycle; must not block
  Worker(
      BinSetup setup, Records& records, std::vector<Publisher*> publishers, Clock& clock, RigOpener open,
      std::function<void()> on_cycle = [] {});
  /// Stops.
  ~Worker();

  /// To be called once the monitor is restored and prepared.
  /// @param max_cycles 0: without end; after so many the worker idles
  void Start(std::uint64_t max_cycles = 0);
  /// Asks the thread to end and returns at once.
  void RequestStop() noexcept;
  /// Returns when the thread has ended and its devices are closed, projectors off. Interrupts a capture that blocks.
  void Stop() noexcept;
  /// True when `max_cycles` have been run.
  [[nodiscard]] bool Done() const { return done_; }
  [[nodiscard]] BinMonitor& monitor() { return monitor_; }

 private:
  void Run(const std::stop_token& stop, std::uint64_t max_cycles);

  BinMonitor monitor_;
  Clock& clock_;
  std::function<void()> on_cycle_;
  std::atomic<bool> done_ = false;
  std::atomic<bool> ended_ = true;
  std::jthread thread_;
};

/// What the loop does at `now`, given the run it is waiting for.
struct Due {
  bool run = false;   ///< measure now
  UtcTime next_at{};  ///< else wait for this
};

/// A clock that was set back must not silence a bin for hours: a run that the schedule now has earlier is taken.
[[nodiscard]] Due WhatIsDue(const ScheduleOptions& schedule, UtcTime start, UtcTime next_at, UtcTime now);

}  // namespace granary
