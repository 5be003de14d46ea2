// What changes from one reading to the next, for a person who watches.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "daemon/ctl/modbus_reading.h"

namespace granary {

/// "sequence 17  19.5 m3  1.4 %  valid, simulated; class 3; reason 0", and alarm bits where any is on.
/// @param reading of the summary
[[nodiscard]] std::string WatchLine(const Reading& reading);

/// Remembers the reading before. Not thread-safe.
class ReadingLog {
 public:
  /// What to tell of a reading: its line when it differs, a heartbeat that stands still or goes on again, a restart.
  /// @param reading of summary and diagnostics
  [[nodiscard]] std::vector<std::string> Lines(const Reading& reading, std::chrono::steady_clock::time_point now);

 private:
  std::string line_;
  std::optional<std::int64_t> heartbeat_, restarts_;
  std::chrono::steady_clock::time_point heartbeat_at_{};
  bool stands_still_ = false;
};

}  // namespace granary
