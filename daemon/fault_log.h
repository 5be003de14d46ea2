// A repeating fault is logged when it changes, then hourly.
#pragma once

#include <chrono>
#include <string>
#include <string_view>

namespace granary {

/// One source of faults. Used by one thread.
class FaultLog {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// True when `fault` is to be logged at `now`: it differs from the one before, or an hour has passed.
  [[nodiscard]] bool Raise(std::string_view fault, Time now) {
    if (fault == fault_ && now - logged_ < std::chrono::hours{1}) return false;
    fault_ = fault;
    logged_ = now;
    return true;
  }
  /// Ends the fault. @return true when there was one, so that its end is logged once
  bool Clear() {
    const bool was = !fault_.empty();
    fault_.clear();
    return was;
  }

 private:
  std::string fault_;
  Time logged_{};
};

}  // namespace granary
