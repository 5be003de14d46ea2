// One list of fields serves both directions, so that they cannot drift apart.
#include "daemon/record_json.h"

#include <date/date.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <sstream>
#include <stdexcept>
#include <type_traits>

namespace granary {
namespace {

using Json = nlohmann::ordered_json;

/// Calls `visit(key, field)` for every field that needs no care, in the order in which they are printed.
/// @tparam Record Measurement or const Measurement
template <typename Record, typename Visit>
void ForEachField(Record& m, Visit visit) {
  visit("volume_m3", m.volume_m3);
  visit("volume_u95_m3", m.volume_u95_m3);
  visit("volume_measured_m3", m.volume_measured_m3);
  visit("volume_interpolated_m3", m.volume_interpolated_m3);
  visit("coverage_percent", m.coverage_percent);
  visit("level_mean_m", m.level_mean_m);
  visit("level_min_m", m.level_min_m);
  visit("level_max_m", m.level_max_m);
  visit("mass_kg", m.mass_kg);
  visit("mass_check_kg", m.mass_check_kg);
  visit("book_mass_kg", m.book_mass_kg);
  visit("error_rate_percent", m.error_rate_percent);
  visit("error_rate_u95_percent", m.error_rate_u95_percent);
  visit("abnormal", m.abnormal);
  visit("edge_threshold_m", m.edge_threshold_m);
  visit("points", m.points);
  visit("triangles", m.triangles);
  visit("timings_ms", m.timings_ms);
  visit("peak_rss_mib", m.peak_rss_mib);
  visit("simulated", m.simulated);
  visit("reduced_accuracy", m.reduced_accuracy);
  visit("volume_percent", m.volume_percent);
  visit("free_volume_m3", m.free_volume_m3);
  visit("distance_mean_m", m.distance_mean_m);
  visit("distance_min_m", m.distance_min_m);
  visit("distance_max_m", m.distance_max_m);
  visit("density_kg_m3", m.density_kg_m3);
  visit("correction", m.correction);
  visit("loss_kg", m.loss_kg);
  visit("segment_distance_m", m.segment_distance_m);
  visit("skew_us", m.skew_us);
  visit("pulse_us", m.pulse_us);
  visit("speckle_contrast", m.speckle_contrast);
  visit("saturated_percent", m.saturated_percent);
  visit("epipolar_rms_px", m.epipolar_rms_px);
  visit("temperature_c", m.temperature_c);
  visit("repeatability_rsd_percent", m.repeatability_rsd_percent);
}

template <typename Budget, typename Visit>
void ForEachTerm(Budget& b, Visit visit) {
  visit("matching", b.matching_m3);
  visit("reference", b.reference_m3);
  visit("calibration", b.calibration_m3);
  visit("pose", b.pose_m3);
  visit("completion", b.completion_m3);
  visit("relief", b.relief_m3);
  visit("repeat", b.repeat_m3);
}

template <typename Timings, typename Visit>
void ForEachStage(Timings& t, Visit visit) {
  visit("capture", t.capture);
  visit("rectify", t.rectify);
  visit("match", t.match);
  visit("cloud", t.cloud);
  visit("segment", t.segment);
  visit("mesh", t.mesh);
  visit("volume", t.volume);
  visit("total", t.total);
}

Json Finite(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }
/// A stage that ran took some time: 0 means that it did not run.
Json Positive(double value) { return value > 0 ? Finite(value) : Json(nullptr); }

/// The value under `key`; null when it is absent.
const Json& Find(const Json& record, const char* key) {
  static const Json kNull;
  const auto found = record.find(key);
  return found == record.end() ? kNull : *found;
}

/// Reads one JSON value into a field; null leaves the field as it is.
template <typename T>
void Read(const Json& value, const std::string& key, T& field) {
  if (value.is_null()) return;
  const auto refuse = [&](const char* wanted) {
    throw std::invalid_argument("record: " + key + ": is " + value.dump() + ", must be " + wanted + " or null");
  };
  if constexpr (std::is_same_v<T, bool> || std::is_same_v<T, std::optional<bool>>) {
    if (!value.is_boolean()) refuse("true, false");
    field = value.get<bool>();
  } else if constexpr (std::is_same_v<T, std::uint64_t>) {
    // A parsed number is unsigned, one set from an int is not, though both may be the same.
    if (!value.is_number_integer() || (!value.is_number_unsigned() && value.get<std::int64_t>() < 0)) {
      refuse("a whole number from 0");
    }
    field = value.get<std::uint64_t>();
  } else if constexpr (std::is_same_v<T, std::string>) {
    if (!value.is_string()) refuse("a text");
    field = value.get<std::string>();
  } else {
    if (!value.is_number()) refuse("a number");
    field = value.get<double>();
  }
}

UtcTime ParseUtc(const Json& record) {
  std::string text;
  std::uint64_t nanoseconds = 0;
  Read(Find(record, "utc"), "utc", text);
  Read(Find(record, "utc_ns"), "utc_ns", nanoseconds);
  std::istringstream in(text);
  UtcTime utc{};
  date::from_stream(in, "%Y-%m-%dT%H:%M:%SZ", utc);
  if (!in || in.peek() != std::istringstream::traits_type::eof() || nanoseconds >= 1'000'000'000) {
    throw std::invalid_argument("record: utc: is \"" + text +
                                "\", must be like 2026-11-22T06:00:00Z, utc_ns below 1e9");
  }
  return utc + std::chrono::nanoseconds{nanoseconds};
}

}  // namespace

std::string UtcText(UtcTime utc) { return date::format("%Y-%m-%dT%H:%M:%SZ", date::floor<std::chrono::seconds>(utc)); }

Reason ReasonNamed(std::string_view name) {
  const auto& table = ReasonTable();
  const auto row = std::find_if(table.begin(), table.end(), [&](const auto& info) { return info.name == name; });
  if (row == table.end()) throw std::invalid_argument("record: reason: \"" + std::string(name) + "\" is unknown");
  return row->reason;
}

nlohmann::ordered_json RecordToJson(const Measurement& measurement) {
  const auto seconds = date::floor<std::chrono::seconds>(measurement.utc);
  Json record;
  record["bin"] = measurement.bin;
  record["sequence"] = measurement.sequence;
  record["utc"] = UtcText(measurement.utc);
  record["valid"] = measurement.valid;
  record["reason"] = std::string(InfoOf(measurement.reason).name);
  ForEachField(measurement, [&](const char* key, const auto& field) {
    using T = std::decay_t<decltype(field)>;
    if constexpr (std::is_same_v<T, StageTimings_ms>) {
      Json& stages = record[key] = Json::object();
      ForEachStage(field, [&](const char* stage, double value_ms) { stages[stage] = Positive(value_ms); });
    } else if constexpr (std::is_same_v<T, std::uint64_t>) {
      record[key] = field == 0 && !measurement.valid ? Json(nullptr) : Json(field);
    } else if constexpr (std::is_same_v<T, double>) {
      record[key] = Positive(field);
    } else if constexpr (std::is_same_v<T, std::optional<double>>) {
      record[key] = field ? Finite(*field) : Json(nullptr);
    } else if constexpr (std::is_same_v<T, std::optional<bool>>) {
      record[key] = field ? Json(*field) : Json(nullptr);
    } else {
      record[key] = field;
    }
  });
  record["shots"] = measurement.shots;
  Json& budget = record["budget_m3"] = nullptr;
  if (measurement.budget) {
    ForEachTerm(*measurement.budget, [&](const char* term, double value_m3) { budget[term] = Finite(value_m3); });
  }
  record["reference_id"] = measurement.reference_id.empty() ? Json(nullptr) : Json(measurement.reference_id);
  record["detail"] = measurement.detail;
  record["utc_ns"] = (measurement.utc - seconds).count();
  return record;
}

std::string RecordLine(const Measurement& measurement) {
  return RecordToJson(measurement).dump(-1, ' ', false, Json::error_handler_t::replace);
}

Measurement RecordFromJson(const nlohmann::ordered_json& record) {
  if (!record.is_object()) throw std::invalid_argument("record: is no JSON object");
  Measurement m;
  std::uint64_t bin = 0;
  Read(Find(record, "bin"), "bin", bin);
  if (bin < 1 || bin > 247) throw std::invalid_argument("record: bin: must be 1 to 247");
  m.bin = static_cast<int>(bin);
  Read(Find(record, "sequence"), "sequence", m.sequence);
  m.utc = ParseUtc(record);
  Read(Find(record, "valid"), "valid", m.valid);
  std::string reason(InfoOf(m.reason).name);
  Read(Find(record, "reason"), "reason", reason);
  m.reason = ReasonNamed(reason);
  ForEachField(m, [&](const char* key, auto& field) {
    if constexpr (std::is_same_v<std::decay_t<decltype(field)>, StageTimings_ms>) {
      const Json& stages = Find(record, key);
      if (stages.is_null()) return;
      if (!stages.is_object()) throw std::invalid_argument("record: timings_ms: must be an object");
      ForEachStage(field, [&](const char* stage, double& value_ms) {
        Read(Find(stages, stage), std::string(key) + "." + stage, value_ms);
      });
    } else {
      Read(Find(record, key), key, field);
    }
  });
  std::uint64_t shots = 1;
  Read(Find(record, "shots"), "shots", shots);
  if (shots < 1 || shots > 1000) throw std::invalid_argument("record: shots: must be 1 to 1000");
  m.shots = static_cast<int>(shots);
  const Json& budget = Find(record, "budget_m3");
  if (!budget.is_null()) {
    if (!budget.is_object()) throw std::invalid_argument("record: budget_m3: must be an object");
    ForEachTerm(m.budget.emplace(), [&](const char* term, double& value_m3) {
      Read(Find(budget, term), std::string("budget_m3.") + term, value_m3);
    });
  }
  Read(Find(record, "reference_id"), "reference_id", m.reference_id);
  Read(Find(record, "detail"), "detail", m.detail);
  return m;
}

}  // namespace granary
