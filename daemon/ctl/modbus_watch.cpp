// Age and heartbeat differ in every reading, so they make no line; a heartbeat that stops makes one.
#include "daemon/ctl/modbus_watch.h"

#include <string>

#include "config/values.h"

namespace granary {
namespace {

constexpr std::chrono::seconds kHeartbeatPatience{5};

}  // namespace

std::string WatchLine(const Reading& reading) {
  const auto status = StatusNames(reading.IntegerOf("status"));
  std::string line = "sequence " + TextOf(reading.Of("sequence")) + "  " + TextOf(reading.Of("volume")) + " m3  " +
                     TextOf(reading.Of("error_rate")) + " %  " + (status.empty() ? "no status bit" : Join(status)) +
                     "; class " + TextOf(reading.Of("namur_class")) + "; reason " + TextOf(reading.Of("reason"));
  if (reading.IntegerOf("alarms_active") != 0) line += "; alarms " + TextOf(reading.Of("alarms_active"));
  if (reading.IntegerOf("alarms_latched") != 0) line += "; latched " + TextOf(reading.Of("alarms_latched"));
  return line;
}

std::vector<std::string> ReadingLog::Lines(const Reading& reading, std::chrono::steady_clock::time_point now) {
  std::vector<std::string> lines;
  const std::int64_t restarts = reading.IntegerOf("restarts");
  if (restarts_ && restarts != *restarts_) lines.emplace_back("granaryd was started again");
  restarts_ = restarts;

  const std::int64_t heartbeat = reading.IntegerOf("heartbeat");
  if (!heartbeat_ || heartbeat != *heartbeat_) {
    heartbeat_at_ = now;
    if (stands_still_) lines.emplace_back("the heartbeat goes on");
    stands_still_ = false;
  } else if (!stands_still_ && now - heartbeat_at_ >= kHeartbeatPatience) {
    lines.emplace_back("the heartbeat stands still: the server answers, but nothing behind it makes progress");
    stands_still_ = true;
  }
  heartbeat_ = heartbeat;

  if (const std::string line = WatchLine(reading); line != line_) lines.push_back(line_ = line);
  return lines;
}

}  // namespace granary
