// A reading as a table for people and as a JSON document.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "daemon/ctl/modbus_reading.h"

namespace granary {

/// What register 0, 1, 2 and 3 say in words, and what is wrong with the reading itself: one line each.
/// @param summary with the summary block
[[nodiscard]] std::vector<std::string> Verdict(const Reading& summary);

/// One line a register: address, name, value, unit; a time also as UTC.
[[nodiscard]] std::vector<std::string> ValueTable(const Reading& reading);

/// Names and values of `reading`, what is unknown as null, and the verdict by name.
/// @param summary with the summary block
[[nodiscard]] nlohmann::ordered_json ReadingToJson(const Reading& summary, const Reading& reading);

/// Registers 5 and 64 are equal, as they are in one read of one snapshot.
[[nodiscard]] bool IsOneSnapshot(const Reading& summary);

}  // namespace granary
