// When a bin is measured next.
#pragma once

#include <chrono>

#include "daemon/options.h"
#include "pipeline/types/frame.h"

namespace granary {

/// The first run later than `now`.
///
/// `every`: the points of the grid start + k·every; points that passed unused are left out, so a long cycle or a
/// machine that slept is never followed by a burst. `at`: those local times in `timezone`. A time that the clocks skip
/// (spring) runs once at the moment they jump; a time that comes twice (autumn) runs at the first.
/// @param start any point of the grid, e.g. when the daemon started
/// @throws std::invalid_argument for an unknown time zone or an `every` that is not positive
[[nodiscard]] UtcTime NextRun(const ScheduleOptions& schedule, UtcTime start, UtcTime now);

/// The first run of a daemon that started at `now`: at once with `every`, at the next of the times with `at`.
[[nodiscard]] UtcTime FirstRun(const ScheduleOptions& schedule, UtcTime now);

/// Age at which a figure is stale: `cycle.stale_after`, or three times the longest pause of the schedule.
[[nodiscard]] std::chrono::milliseconds StaleAfter(const ScheduleOptions& schedule, const CycleOptions& cycle);

}  // namespace granary
