#include "daemon/record_json.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "tests/daemon/fakes.h"

namespace granary {
namespace {

using Json = nlohmann::ordered_json;

/// Every field set to a value of its own.
Measurement Full() {
  Measurement m;
  m.bin = 7;
  m.sequence = 17;
  m.utc = At("2026-11-22T06:00:00Z") + std::chrono::nanoseconds{123456789};
  m.valid = m.simulated = m.reduced_accuracy = true;
  m.reason = Reason::kOk;
  m.detail = "half of the floor lies in shadow";
  double value = 0.1;
  for (auto* field : {&m.volume_m3,
                      &m.volume_u95_m3,
                      &m.volume_measured_m3,
                      &m.volume_interpolated_m3,
                      &m.volume_percent,
                      &m.free_volume_m3,
                      &m.coverage_percent,
                      &m.level_mean_m,
                      &m.level_min_m,
                      &m.level_max_m,
                      &m.distance_mean_m,
                      &m.distance_min_m,
                      &m.distance_max_m,
                      &m.density_kg_m3,
                      &m.correction,
                      &m.loss_kg,
                      &m.mass_kg,
                      &m.mass_check_kg,
                      &m.book_mass_kg,
                      &m.error_rate_percent,
                      &m.error_rate_u95_percent,
                      &m.edge_threshold_m,
                      &m.segment_distance_m,
                      &m.skew_us,
                      &m.pulse_us,
                      &m.speckle_contrast,
                      &m.saturated_percent,
                      &m.epipolar_rms_px,
                      &m.temperature_c}) {
    *field = value *= -1.1;
  }
  m.abnormal = true;
  m.points = 1'000'000;
  m.triangles = 2'000'000;
  m.reference_id = "bin7-a-20261122T060000Z";
  m.shots = 3;
  m.repeatability_rsd_percent = 0.02;
  m.budget = UncertaintyBudget{1e-5, 2e-5, 3e-5, 4e-5, 5e-5, 6e-5, 7e-5};
  m.timings_ms = {1, 2, 3, 4, 5, 6, 7, 28};
  m.peak_rss_mib = 512.5;
  return m;
}

TEST(RecordToJson, HasTheAgreedKeysInOrder) {
  const std::vector<std::string> agreed{"bin",
                                        "sequence",
                                        "utc",
                                        "valid",
                                        "reason",
                                        "volume_m3",
                                        "volume_u95_m3",
                                        "volume_measured_m3",
                                        "volume_interpolated_m3",
                                        "coverage_percent",
                                        "level_mean_m",
                                        "level_min_m",
                                        "level_max_m",
                                        "mass_kg",
                                        "mass_check_kg",
                                        "book_mass_kg",
                                        "error_rate_percent",
                                        "error_rate_u95_percent",
                                        "abnormal",
                                        "edge_threshold_m",
                                        "points",
                                        "triangles",
                                        "timings_ms",
                                        "peak_rss_mib"};
  const Json record = RecordToJson(Full());
  std::vector<std::string> keys;
  for (const auto& [key, value] : record.items()) keys.push_back(key);
  ASSERT_GE(keys.size(), agreed.size());
  keys.resize(agreed.size());
  EXPECT_EQ(keys, agreed);
}

TEST(RecordToJson, NamesTheStages) {
  EXPECT_EQ(
      RecordToJson(Full())["timings_ms"].dump(),
      R"({"capture":1.0,"rectify":2.0,"match":3.0,"cloud":4.0,"segment":5.0,"mesh":6.0,"volume":7.0,"total":28.0})");
}

TEST(RecordToJson, NamesTheTermsOfTheBudget) {
  EXPECT_EQ(RecordToJson(Full())["budget_m3"].dump(),
            R"({"matching":1e-05,"reference":2e-05,"calibration":3e-05,"pose":4e-05,"completion":5e-05,"relief":6e-05,)"
            R"("repeat":7e-05})");
}

TEST(RecordFromJson, RefusesABudgetThatIsNone) {
  Json record = RecordToJson(Full());
  record["budget_m3"] = 3;
  EXPECT_THROW((void)RecordFromJson(record), std::invalid_argument);
  record = RecordToJson(Full());
  record["budget_m3"]["relief"] = "large";
  EXPECT_THROW((void)RecordFromJson(record), std::invalid_argument);
}

TEST(RecordFromJson, RefusesANumberOfShotsThatIsNone) {
  Json record = RecordToJson(Full());
  record["shots"] = 0;
  EXPECT_THROW((void)RecordFromJson(record), std::invalid_argument);
}

TEST(RecordToJson, WritesTimeAndReasonAsWords) {
  const Json record = RecordToJson(Full());
  EXPECT_EQ(record["utc"], "2026-11-22T06:00:00Z");
  EXPECT_EQ(record["reason"], "ok");
}

TEST(RecordToJson, WritesUnknownAsNullEverywhere) {
  const Json record = RecordToJson(Measurement{});
  for (const auto& [key, value] : record.items()) {
    const bool known = value.is_boolean() || value.is_string() || key == "bin" || key == "sequence" ||
                       key == "utc_ns" || key == "timings_ms" || key == "shots";
    EXPECT_TRUE(known || value.is_null()) << key << " is " << value;
  }
  for (const auto& [stage, value] : record["timings_ms"].items()) EXPECT_TRUE(value.is_null()) << stage;
  EXPECT_TRUE(record["abnormal"].is_null());
}

TEST(RecordToJson, WritesWhatIsNotFiniteAsNull) {
  Measurement m = Full();
  m.volume_m3 = std::numeric_limits<double>::quiet_NaN();
  m.mass_kg = std::numeric_limits<double>::infinity();
  m.timings_ms.total = -std::numeric_limits<double>::infinity();
  m.peak_rss_mib = std::numeric_limits<double>::quiet_NaN();
  const Json record = RecordToJson(m);
  EXPECT_TRUE(record["volume_m3"].is_null());
  EXPECT_TRUE(record["mass_kg"].is_null());
  EXPECT_TRUE(record["timings_ms"]["total"].is_null());
  EXPECT_TRUE(record["peak_rss_mib"].is_null());
}

TEST(RecordToJson, KeepsAMeasuredZero) {
  Measurement m = Full();
  m.volume_m3 = 0.0;
  EXPECT_EQ(RecordToJson(m)["volume_m3"], 0.0);
}

TEST(RecordLine, ReplacesBytesThatAreNoUtf8) {
  Measurement m = Full();
  m.detail = "camera \xff says";
  EXPECT_EQ(Json::parse(RecordLine(m))["detail"], "camera \xEF\xBF\xBD says");
}

TEST(RecordFromJson, GivesBackEveryField) {
  const Measurement back = RecordFromJson(Json::parse(RecordLine(Full())));
  EXPECT_EQ(RecordLine(back), RecordLine(Full()));
  EXPECT_EQ(back.utc, Full().utc);
}

TEST(RecordFromJson, GivesBackUnknownAsEmpty) {
  const Measurement back = RecordFromJson(RecordToJson(Measurement{}));
  EXPECT_FALSE(back.volume_m3);
  EXPECT_FALSE(back.abnormal);
  EXPECT_EQ(back.reason, Reason::kNotMeasured);
}

TEST(RecordFromJson, IgnoresKeysOfLaterVersions) {
  Json record = RecordToJson(Full());
  record["moisture_percent"] = 12.5;
  EXPECT_EQ(RecordFromJson(record).sequence, 17U);
}

/// The words of the refusal of a full record with one key changed.
std::string Refusal(const std::string& key, const Json& value) {
  Json record = RecordToJson(Full());
  record[key] = value;
  try {
    static_cast<void>(RecordFromJson(record));
    return "accepted";
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
}

TEST(RecordFromJson, NamesTheKeyThatIsWrong) {
  EXPECT_EQ(Refusal("volume_m3", "much"), "record: volume_m3: is \"much\", must be a number or null");
  EXPECT_EQ(Refusal("abnormal", 1), "record: abnormal: is 1, must be true, false or null");
  EXPECT_EQ(Refusal("points", -1), "record: points: is -1, must be a whole number from 0 or null");
  EXPECT_EQ(Refusal("reason", "bad_luck"), "record: reason: \"bad_luck\" is unknown");
  EXPECT_EQ(Refusal("bin", 0), "record: bin: must be 1 to 247");
  EXPECT_EQ(Refusal("timings_ms", 5), "record: timings_ms: must be an object");
  EXPECT_NE(Refusal("utc", "yesterday").find("record: utc: is \"yesterday\""), std::string::npos);
}

TEST(RecordFromJson, RefusesWhatIsNoObject) {
  EXPECT_THROW(static_cast<void>(RecordFromJson(Json::array())), std::invalid_argument);
}

}  // namespace
}  // namespace granary
