// Everything that a real figure brings along and nobody gave stays unknown: uncertainty, coverage, distances.
#include "daemon/injection.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "pipeline/inventory.h"
#include "pipeline/types/bin.h"

namespace granary {
namespace {

constexpr double kMaxVolume_m3 = 1e6;

void OverrideErrorRate(Measurement& m, double error_rate_percent, const Inventory& inventory) {
  m.error_rate_percent = error_rate_percent;
  m.abnormal = std::abs(error_rate_percent) > inventory.alarm_percent;
  if (m.book_mass_kg) m.mass_check_kg = *m.book_mass_kg * (1 + error_rate_percent / 100);
}

std::optional<double> KnownVolume_m3(const BinSnapshot& bin) { return bin.good ? bin.good->volume_m3 : std::nullopt; }

}  // namespace

std::vector<std::string> Faults(const Injection& injection, const BinSnapshot& bin) {
  std::vector<std::string> faults;
  const auto require = [&](const std::optional<double>& value, double low, double high, const char* words) {
    if (value && !(*value >= low && *value <= high)) faults.emplace_back(words);  // NaN is outside
  };
  require(injection.volume_m3, 0, kMaxVolume_m3, "volume_m3: must be 0 to 1000000");
  require(injection.error_rate_percent, -100, 1000, "error_rate_percent: must be -100 to 1000");
  require(injection.level_mean_m, 0, 100, "level_mean_m: must be 0 to 100");
  require(injection.temperature_c, -60, 150, "temperature_c: must be -60 to 150");
  if (injection.reason == Reason::kOk && !injection.volume_m3 && !KnownVolume_m3(bin)) {
    faults.emplace_back("volume_m3: is missing, and there is no figure yet to take it from; must be 0 to 1000000");
  }
  return faults;
}

nlohmann::ordered_json InjectionToJson(const Injection& injection, std::chrono::seconds duration) {
  nlohmann::ordered_json json{{"seconds", duration.count()}};
  const auto add = [&](const char* key, const std::optional<double>& value) {
    if (value) json[key] = *value;
  };
  add("volume_m3", injection.volume_m3);
  add("error_rate_percent", injection.error_rate_percent);
  add("level_mean_m", injection.level_mean_m);
  add("temperature_c", injection.temperature_c);
  if (injection.reason != Reason::kOk) json["reason"] = std::string(InfoOf(injection.reason).name);
  return json;
}

Injected MakeUp(const Injection& injection, const BinSnapshot& bin, UtcTime now, std::uint64_t sequence,
                const std::string& who) {
  const bool fails = injection.reason != Reason::kOk;
  Measurement m;
  m.bin = bin.bin.id;
  m.sequence = sequence;
  m.utc = now;
  m.simulated = true;
  m.detail = "made up by " + who + " for a loop test";
  m.temperature_c = injection.temperature_c;

  Injected injected;
  injected.last = m;
  injected.last.reason = injection.reason;
  // A failure alone leaves the true figure, as a real one does.
  if (fails && !injection.volume_m3) return injected;

  m.valid = true;
  m.reason = Reason::kOk;
  m.volume_m3 = injection.volume_m3 ? injection.volume_m3 : KnownVolume_m3(bin);
  const double capacity_m3 = Capacity_m3(bin.bin), floor_m2 = GrainFloor_m2(bin.bin);
  if (capacity_m3 > 0) {
    m.volume_percent = *m.volume_m3 / capacity_m3 * 100;
    m.free_volume_m3 = capacity_m3 - *m.volume_m3;
  }
  if (floor_m2 > 0) m.level_mean_m = *m.volume_m3 / floor_m2;
  if (injection.level_mean_m) m.level_mean_m = injection.level_mean_m;
  ApplyInventory(m, bin.book.in_force);
  if (injection.error_rate_percent) OverrideErrorRate(m, *injection.error_rate_percent, bin.book.in_force);
  injected.abnormal_latched = m.abnormal.value_or(false);
  if (!fails) injected.last = m;
  injected.good = std::move(m);
  return injected;
}

BinSnapshot WithInjected(BinSnapshot bin, const Injected& injected) {
  bin.injected = true;
  if (injected.good) {
    bin.good = injected.good;
    bin.stale = false;
  }
  bin.last = injected.last;
  bin.held = !injected.last.valid && bin.good.has_value();
  if (!injected.last.valid) bin.last_failure = injected.last.reason;
  bin.abnormal_latched = bin.abnormal_latched || injected.abnormal_latched;
  bin.rate_m3_h.reset();
  bin.change_m3.reset();
  return bin;
}

std::uint64_t SequenceOf(const BinSnapshot& bin) {
  return std::max(bin.good ? bin.good->sequence : 0, bin.last ? bin.last->sequence : 0);
}

}  // namespace granary
