// The record as JSON: what `measure --json`, the store and the evidence hold.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "pipeline/types/measurement.h"

namespace granary {

/// UTC as ISO 8601, whole seconds (rounded down): "2026-11-22T06:00:00Z".
[[nodiscard]] std::string UtcText(UtcTime utc);

/// Every key, in a fixed order. What is unknown or not finite is null: an empty value, the time of a stage that did not
/// run, the points of a cycle that made none. `utc` has whole seconds, `utc_ns` the nanoseconds to add.
[[nodiscard]] nlohmann::ordered_json RecordToJson(const Measurement& measurement);

/// The same as one line of text; bytes that are no UTF-8 (in a device's words) are replaced.
[[nodiscard]] std::string RecordLine(const Measurement& measurement);

/// The inverse; keys that are absent are unknown, keys that it does not know are left alone.
/// @throws std::invalid_argument naming the key that is no record's
[[nodiscard]] Measurement RecordFromJson(const nlohmann::ordered_json& record);

/// The row of the reason table with this name. @throws std::invalid_argument for an unknown one
[[nodiscard]] Reason ReasonNamed(std::string_view name);

}  // namespace granary
