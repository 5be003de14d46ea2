// The thread looks up every second even when nothing is due for hours: that is its proof of life.
#include "daemon/worker.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "daemon/schedule.h"

namespace granary {
namespace {

constexpr std::chrono::milliseconds kLookUp{1000};
constexpr std::chrono::milliseconds kInterruptAgain{20};

}  // namespace

Due WhatIsDue(const ScheduleOptions& schedule, UtcTime start, UtcTime next_at, UtcTime now) {
  if (now >= next_at) return {true, next_at};
  return {false, std::min(next_at, NextRun(schedule, start, now))};
}

Worker::Worker(BinSetup setup, Records& records, std::vector<Publisher*> publishers, Clock& clock, RigOpener open,
               std::function<void()> on_cycle)
    : monitor_(std::move(setup), records, std::move(publishers), clock, std::move(open)),
      clock_(clock),
      on_cycle_(std::move(on_cycle)) {}

Worker::~Worker() { Stop(); }

void Worker::Start(std::uint64_t max_cycles) {
  ended_ = false;
  thread_ = std::jthread([this, max_cycles](const std::stop_token& stop) {
    monitor_.Open();  // also when the bin is inhibited: a line that a crash left high falls
    Run(stop, max_cycles);
    monitor_.Close();
    ended_ = true;
  });
}

void Worker::RequestStop() noexcept {
  thread_.request_stop();
  monitor_.Interrupt();
}

void Worker::Stop() noexcept {
  if (!thread_.joinable()) return;
  thread_.request_stop();
  // Again and again: an interrupt that comes just before the grab begins to block would be lost.
  while (!ended_) {
    monitor_.Interrupt();
    std::this_thread::sleep_for(kInterruptAgain);
  }
  thread_.join();
}

void Worker::Run(const std::stop_token& stop, std::uint64_t max_cycles) {
  const ScheduleOptions& schedule = monitor_.setup().schedule;
  const UtcTime start = clock_.Now();
  UtcTime next_at = FirstRun(schedule, start);
  std::uint64_t cycles = 0;
  while (!stop.stop_requested()) {
    std::stop_source wake = monitor_.NextWake();
    const std::stop_callback end_too(stop, [&wake] { wake.request_stop(); });
    const auto pause = [&](std::chrono::milliseconds duration) {
      static_cast<void>(clock_.Wait(wake.get_token(), duration));
    };
    const UtcTime now = clock_.Now();
    const Due due = WhatIsDue(schedule, start, next_at, now);
    next_at = due.next_at;
    if (monitor_.RestIfInhibited()) {
      if (due.run) next_at = NextRun(schedule, start, now);
      pause(kLookUp);
      continue;
    }
    const bool asked = monitor_.TakeMeasure();
    if (!asked && (!due.run || done_)) {
      monitor_.Idle(done_ ? std::nullopt : std::optional(next_at));
      if (!done_ && monitor_.TryAgain(stop)) {
        on_cycle_();
        continue;
      }
      // Rounded up: waking a little too early would mean a second, empty turn.
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(next_at - now);
      pause(done_ ? kLookUp : std::clamp(left, std::chrono::milliseconds{1}, kLookUp));
      continue;
    }
    if (!monitor_.RunCycle(stop)) continue;  // ended, or inhibited
    next_at = NextRun(schedule, start, clock_.Now());
    ++cycles;
    done_ = done_ || (max_cycles > 0 && cycles >= max_cycles);
    monitor_.Idle(done_ ? std::nullopt : std::optional(next_at));
    on_cycle_();
  }
}

}  // namespace granary
