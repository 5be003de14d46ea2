// The real clocks; waiting is on the stop token, so that an end is never slept through.
#include "daemon/clock.h"

#include <condition_variable>
#include <mutex>

namespace granary {

UtcTime SystemClock::Now() const {
  return std::chrono::time_point_cast<UtcTime::duration>(std::chrono::system_clock::now());
}

std::chrono::steady_clock::time_point SystemClock::Steady() const { return std::chrono::steady_clock::now(); }

bool SystemClock::Wait(const std::stop_token& stop, std::chrono::milliseconds duration) {
  std::mutex mutex;
  std::condition_variable_any never;
  std::unique_lock lock(mutex);
  never.wait_for(lock, stop, duration, [] { return false; });
  return !stop.stop_requested();
}

}  // namespace granary
