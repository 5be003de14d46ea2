// Values as text: how numbers, durations, times and strings are written in the file.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace granary {

/// Parses a duration with its unit: "250ms", "10s", "1.5h", "30min", "2d".
/// @return empty when the text is none, is no whole number of milliseconds, or is beyond ten years.
[[nodiscard]] std::optional<std::chrono::milliseconds> ParseDuration(std::string_view text);
/// The shortest text that ParseDuration reads back to the same: 1800000 ms is "30min".
[[nodiscard]] std::string PrintDuration(std::chrono::milliseconds duration);

/// Parses a time of the day, "00:00" to "23:59". @return minutes since midnight, empty when it is none.
[[nodiscard]] std::optional<std::chrono::minutes> ParseTimeOfDay(std::string_view text);
[[nodiscard]] std::string PrintTimeOfDay(std::chrono::minutes since_midnight);

/// The shortest decimal that reads back to the same double; always with a point or an exponent, as TOML floats have.
[[nodiscard]] std::string PrintNumber(double value);
/// A TOML basic string, quoted and escaped.
[[nodiscard]] std::string Quote(std::string_view text);
/// `name` as a TOML key: bare where it can be, else quoted.
[[nodiscard]] std::string QuoteKey(std::string_view name);

/// The element of `names` most like `word`; empty when none is like enough to be a slip of the finger.
[[nodiscard]] std::string Nearest(std::string_view word, const std::vector<std::string>& names);
/// "a, b, c".
[[nodiscard]] std::string Join(const std::vector<std::string>& words, std::string_view separator = ", ");

}  // namespace granary
