// Time as the daemon sees it: one seam, so that tests need no sleeping.
#pragma once

#include <chrono>
#include <stop_token>

#include "pipeline/types/frame.h"

namespace granary {

/// Any thread may call any method.
class Clock {
 public:
  virtual ~Clock() = default;
  /// Wall-clock time: schedules and records. It may jump.
  [[nodiscard]] virtual UtcTime Now() const = 0;
  /// Time that never jumps: delays, deadlines and durations.
  [[nodiscard]] virtual std::chrono::steady_clock::time_point Steady() const = 0;
  /// Blocks for `duration`. @return false at once when `stop` is or becomes requested
  [[nodiscard]] virtual bool Wait(const std::stop_token& stop, std::chrono::milliseconds duration) = 0;
};

/// The machine's own clocks.
class SystemClock : public Clock {
 public:
  [[nodiscard]] UtcTime Now() const override;
  [[nodiscard]] std::chrono::steady_clock::time_point Steady() const override;
  [[nodiscard]] bool Wait(const std::stop_token& stop, std::chrono::milliseconds duration) override;
};

}  // namespace granary
