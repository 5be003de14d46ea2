// A made-up figure, published for a while so that the way from this daemon into a PLC can be tested before there is any
// grain. It is marked as simulated, stored nowhere, and never mistaken for a measurement.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "daemon/snapshot.h"
#include "pipeline/types/frame.h"
#include "pipeline/types/measurement.h"
#include "pipeline/types/reason.h"

namespace granary {

/// What to make up; what is empty follows from the rest, or is unknown.
struct Injection {
  std::optional<double> volume_m3{};           ///< empty: that of the last good figure
  std::optional<double> error_rate_percent{};  ///< empty: follows from volume and book data
  std::optional<double> level_mean_m{};        ///< empty: volume over the floor's area
  std::optional<double> temperature_c{};
  Reason reason = Reason::kOk;  ///< another: the cycle failed with it, and the figure is held
};

/// What is wrong with it: one "key: what, what is allowed" each; empty when all is well. Keys are the members' names.
/// @param bin as published; without a good figure a volume is needed, unless the cycle is to fail
[[nodiscard]] std::vector<std::string> Faults(const Injection& injection, const BinSnapshot& bin);

/// As the journal has it: what was given, and "seconds".
[[nodiscard]] nlohmann::ordered_json InjectionToJson(const Injection& injection, std::chrono::seconds duration);

/// An injection at work. A plain value.
struct Injected {
  std::optional<Measurement> good;  ///< empty: the true one, held
  Measurement last;
  bool abnormal_latched = false;
};

/// Makes it up out of `bin` as it is: quantity, error rate and verdict by ApplyInventory with the book data in force.
/// An error rate that is given wins: checked quantity and verdict follow it.
/// @param sequence its number; one that was not published yet tells a client that there is news
[[nodiscard]] Injected MakeUp(const Injection& injection, const BinSnapshot& bin, UtcTime now, std::uint64_t sequence,
                              const std::string& who);

/// `bin` with the figure in place of the true one.
[[nodiscard]] BinSnapshot WithInjected(BinSnapshot bin, const Injected& injected);

/// The sequence number that a client sees of `bin`; 0 when there is none yet.
[[nodiscard]] std::uint64_t SequenceOf(const BinSnapshot& bin);

}  // namespace granary
