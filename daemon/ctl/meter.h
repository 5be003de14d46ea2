// What the live meter shows of one pair.
#pragma once

#include <optional>
#include <string>

#include "drivers/rig.h"
#include "pipeline/quality.h"

namespace granary {

struct MeterReading {
  std::optional<double> pairs_per_s, skew_us, pulse_us, temperature_c;
  PictureQuality left, right;
  RigCounters counters;  ///< since the meter was started
};

/// What the columns of MeterLine are, in two lines.
[[nodiscard]] std::string MeterHeader();
/// One line of at most 80 characters; what is unknown is a dash.
[[nodiscard]] std::string MeterLine(const MeterReading& reading);

}  // namespace granary
