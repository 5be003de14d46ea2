// Runs are computed, never counted: the next one depends on the options and the time alone, so a late, repeated or
// skipped call cannot make the schedule drift.
#include "daemon/schedule.h"

#include <date/tz.h>

#include <algorithm>
#include <optional>
#include <stdexcept>
#include <string>

namespace granary {
namespace {

/// Local and absolute time of one zone. "UTC" works without a time zone database.
class Zone {
 public:
  explicit Zone(const std::string& name) {
    if (name == "UTC") return;
    try {
      zone_ = date::locate_zone(name);
    } catch (const std::exception& fault) {
      throw std::invalid_argument("timezone \"" + name + "\" is not in the time zone database: " + fault.what());
    }
  }

  [[nodiscard]] date::local_days DayOf(UtcTime time) const {
    const auto seconds = date::floor<std::chrono::seconds>(time);
    const auto local = zone_ ? zone_->to_local(seconds) : date::local_seconds{seconds.time_since_epoch()};
    return date::floor<date::days>(local);
  }

  /// The moment when the clocks on the wall first show `local` or, where they skip it, jump over it.
  [[nodiscard]] UtcTime FirstMomentOf(date::local_seconds local) const {
    if (!zone_) return UtcTime{local.time_since_epoch()};
    const date::local_info info = zone_->get_info(local);
    if (info.result == date::local_info::nonexistent) return info.second.begin;
    return UtcTime{local.time_since_epoch() - info.first.offset};
  }

 private:
  const date::time_zone* zone_ = nullptr;
};

}  // namespace

UtcTime NextRun(const ScheduleOptions& schedule, UtcTime start, UtcTime now) {
  if (schedule.at.empty()) {
    if (schedule.every.count() <= 0) throw std::invalid_argument("schedule.every must be more than 0");
    const UtcTime::duration every = schedule.every;
    const auto since = now - start;
    // Towards minus infinity, so that a clock set back before `start` stays on the grid too.
    const auto passed = since / every - (since % every < since.zero() ? 1 : 0);
    return start + (passed + 1) * every;
  }
  const Zone zone(schedule.timezone);
  std::optional<UtcTime> next;
  // A skipped day (Samoa 2011) and a gap over midnight put a run a day off its own date: look at the neighbours too.
  for (int day = -1; day <= 2; ++day) {
    for (const auto minutes : schedule.at) {
      const UtcTime run = zone.FirstMomentOf(zone.DayOf(now) + date::days{day} + minutes);
      if (run > now && (!next || run < *next)) next = run;
    }
  }
  return next.value();
}

UtcTime FirstRun(const ScheduleOptions& schedule, UtcTime now) {
  return schedule.at.empty() ? now : NextRun(schedule, now, now);
}

std::chrono::milliseconds StaleAfter(const ScheduleOptions& schedule, const CycleOptions& cycle) {
  if (cycle.stale_after.count() > 0) return cycle.stale_after;
  if (schedule.at.empty()) return 3 * schedule.every;
  constexpr std::chrono::minutes kDay = std::chrono::hours{24};
  std::vector<std::chrono::minutes> at = schedule.at;
  std::sort(at.begin(), at.end());
  std::chrono::minutes longest = at.front() + kDay - at.back();
  for (std::size_t i = 1; i < at.size(); ++i) longest = std::max(longest, at[i] - at[i - 1]);
  return 3 * longest;
}

}  // namespace granary
