#include "daemon/schedule.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "daemon/worker.h"
#include "tests/daemon/fakes.h"

namespace granary {
namespace {

using namespace std::chrono_literals;

ScheduleOptions Every(std::chrono::milliseconds every) {
  ScheduleOptions schedule;
  schedule.every = every;
  return schedule;
}

ScheduleOptions Times(std::vector<std::chrono::minutes> at, const std::string& timezone) {
  ScheduleOptions schedule;
  schedule.at = std::move(at);
  schedule.timezone = timezone;
  return schedule;
}

/// The next run as text, counted from `now`.
std::string Next(const ScheduleOptions& schedule, const std::string& now) {
  return UtcText(NextRun(schedule, At("2026-01-01T00:00:00Z"), At(now)));
}

TEST(NextRun, StaysOnTheGridFromStart) {
  EXPECT_EQ(Next(Every(30min), "2026-01-01T00:00:01Z"), "2026-01-01T00:30:00Z");
  EXPECT_EQ(Next(Every(30min), "2026-01-01T10:59:59Z"), "2026-01-01T11:00:00Z");
}

TEST(NextRun, IsAlwaysLaterThanNow) { EXPECT_EQ(Next(Every(30min), "2026-01-01T00:30:00Z"), "2026-01-01T01:00:00Z"); }

TEST(NextRun, LeavesMissedRunsOut) { EXPECT_EQ(Next(Every(1min), "2026-01-03T07:08:09Z"), "2026-01-03T07:09:00Z"); }

TEST(NextRun, KeepsTheGridBeforeStart) {
  EXPECT_EQ(Next(Every(30min), "2025-12-31T23:10:00Z"), "2025-12-31T23:30:00Z");
}

TEST(NextRun, TakesGridsFinerThanASecond) {
  const UtcTime start = At("2026-01-01T00:00:00Z");
  EXPECT_EQ(NextRun(Every(100ms), start, start + 250ms), start + 300ms);
}

TEST(NextRun, RefusesNoInterval) {
  EXPECT_THROW(static_cast<void>(NextRun(Every(0ms), UtcTime{}, UtcTime{})), std::invalid_argument);
}

TEST(NextRun, RunsAtLocalTimes) {
  const auto schedule = Times({6h, 18h}, "Asia/Shanghai");  // UTC+8, no summer time
  EXPECT_EQ(Next(schedule, "2026-11-22T00:00:00Z"), "2026-11-22T10:00:00Z");
  EXPECT_EQ(Next(schedule, "2026-11-22T10:00:00Z"), "2026-11-22T22:00:00Z");
}

TEST(NextRun, KeepsLocalTimeAcrossSpring) {
  const auto schedule = Times({6h}, "Europe/Berlin");  // summer time began on 2026-03-29 at 01:00 UTC
  EXPECT_EQ(Next(schedule, "2026-03-28T04:00:00Z"), "2026-03-28T05:00:00Z");
  EXPECT_EQ(Next(schedule, "2026-03-28T05:00:00Z"), "2026-03-29T04:00:00Z");
}

TEST(NextRun, RunsASkippedTimeOnceWhenTheClocksJump) {
  const auto schedule = Times({2h + 30min}, "Europe/Berlin");  // 02:30 does not exist on 2026-03-29
  EXPECT_EQ(Next(schedule, "2026-03-28T12:00:00Z"), "2026-03-29T01:00:00Z");
  EXPECT_EQ(Next(schedule, "2026-03-29T01:00:00Z"), "2026-03-30T00:30:00Z");
}

TEST(NextRun, RunsTwoSkippedTimesOnce) {
  const auto schedule = Times({2h, 2h + 30min, 3h}, "Europe/Berlin");  // all three are 01:00 UTC that day
  EXPECT_EQ(Next(schedule, "2026-03-29T00:59:59Z"), "2026-03-29T01:00:00Z");
  EXPECT_EQ(Next(schedule, "2026-03-29T01:00:00Z"), "2026-03-30T00:00:00Z");
}

TEST(NextRun, RunsADoubledTimeOnceAtTheFirst) {
  const auto schedule = Times({2h + 30min}, "Europe/Berlin");  // 02:30 comes at 00:30 and at 01:30 UTC on 2026-10-25
  EXPECT_EQ(Next(schedule, "2026-10-24T12:00:00Z"), "2026-10-25T00:30:00Z");
  EXPECT_EQ(Next(schedule, "2026-10-25T00:30:00Z"), "2026-10-26T01:30:00Z");
}

TEST(NextRun, FollowsLocalDatesFarFromGreenwich) {
  EXPECT_EQ(Next(Times({30min}, "Pacific/Kiritimati"), "2026-11-22T10:00:00Z"), "2026-11-22T10:30:00Z");  // UTC+14
  EXPECT_EQ(Next(Times({23h}, "Pacific/Pago_Pago"), "2026-11-22T09:00:00Z"), "2026-11-22T10:00:00Z");     // UTC−11
}

TEST(NextRun, NeedsNoDatabaseForUtc) {
  EXPECT_EQ(Next(Times({6h}, "UTC"), "2026-11-22T06:00:00Z"), "2026-11-23T06:00:00Z");
}

TEST(NextRun, NamesAnUnknownTimeZone) {
  try {
    Next(Times({6h}, "Mars/Olympus"), "2026-11-22T06:00:00Z");
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("Mars/Olympus"), std::string::npos);
  }
}

TEST(FirstRun, IsAtOnceForEvery) {
  EXPECT_EQ(FirstRun(Every(30min), At("2026-11-22T06:01:00Z")), At("2026-11-22T06:01:00Z"));
}

TEST(FirstRun, WaitsForTheTimes) {
  EXPECT_EQ(FirstRun(Times({6h}, "UTC"), At("2026-11-22T06:01:00Z")), At("2026-11-23T06:00:00Z"));
}

TEST(StaleAfter, IsThreeTimesTheSchedule) { EXPECT_EQ(StaleAfter(Every(30min), {}), 90min); }

TEST(StaleAfter, CountsTheLongestPauseOfTheDay) { EXPECT_EQ(StaleAfter(Times({6h, 18h, 20h}, "UTC"), {}), 36h); }

TEST(StaleAfter, ObeysTheOption) {
  CycleOptions cycle;
  cycle.stale_after = 10min;
  EXPECT_EQ(StaleAfter(Every(30min), cycle), 10min);
}

TEST(WhatIsDue, RunsWhenTheTimeHasCome) {
  const UtcTime start = At("2026-11-22T06:00:00Z");
  EXPECT_FALSE(WhatIsDue(Every(30min), start, start + 30min, start + 29min).run);
  EXPECT_TRUE(WhatIsDue(Every(30min), start, start + 30min, start + 30min).run);
}

TEST(WhatIsDue, RunsOnceAfterAClockSetForward) {
  const UtcTime start = At("2026-11-22T06:00:00Z");
  EXPECT_TRUE(WhatIsDue(Every(30min), start, start + 30min, start + 5h).run);
  EXPECT_EQ(NextRun(Every(30min), start, start + 5h), start + 5h + 30min);
}

TEST(WhatIsDue, TakesAnEarlierRunAfterAClockSetBack) {
  const UtcTime start = At("2026-11-22T06:00:00Z");
  EXPECT_EQ(WhatIsDue(Every(30min), start, start + 30min, start - 5h).next_at, start - 5h + 30min);
}

}  // namespace
}  // namespace granary
