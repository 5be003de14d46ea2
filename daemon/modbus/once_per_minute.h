// A log line that whoever sends bytes can cause is said once a minute.
#pragma once

#include <chrono>
#include <optional>
#include <utility>

namespace granary {

/// Lets one log line through a minute and counts what it kept back. Used by one thread at a time.
class OncePerMinute {
 public:
  /// @return how many there were since the line before, when it is time for the next
  [[nodiscard]] std::optional<int> Count(std::chrono::steady_clock::time_point now) {
    ++count_;
    if (last_ && now - *last_ < std::chrono::minutes{1}) return std::nullopt;
    last_ = now;
    return std::exchange(count_, 0);
  }

 private:
  std::optional<std::chrono::steady_clock::time_point> last_;
  int count_ = 0;
};

}  // namespace granary
