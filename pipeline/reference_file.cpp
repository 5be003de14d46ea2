// The points go to FOLDER/<id>/reference.pcd first; FOLDER/reference.json is renamed into place last and alone decides
// which version counts. A crash in between leaves the old version current and whole.
#include "pipeline/reference_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <system_error>

#include <nlohmann/json.hpp>

#include "pipeline/cloud_files.h"
#include "pipeline/file_bytes.h"
#include "pipeline/file_error.h"

namespace granary {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kIndexName = "reference.json";
constexpr const char* kCloudName = "reference.pcd";

bool IsPlainName(const std::string& name) {
  return !name.empty() && name.front() != '.' && std::all_of(name.begin(), name.end(), [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '-' || c == '_' || c == '.';
  });
}

/// "2026-11-22T06:00:00.123456789Z".
std::string UtcText(UtcTime utc) {
  const auto day = std::chrono::floor<std::chrono::days>(utc);
  const std::chrono::year_month_day date(day);
  const std::chrono::hh_mm_ss time(utc - day);
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%04d-%02u-%02uT%02d:%02d:%02d.%09lldZ", int(date.year()),
                unsigned(date.month()), unsigned(date.day()), int(time.hours().count()), int(time.minutes().count()),
                int(time.seconds().count()), static_cast<long long>(time.subseconds().count()));
  return text.data();
}

UtcTime ParseUtc(const fs::path& file, const std::string& text) {
  int year = 0, hour = 0, minute = 0, second = 0;
  unsigned month = 0, day = 0;
  long long nanoseconds = 0;
  if (std::sscanf(text.c_str(), "%4d-%2u-%2uT%2d:%2d:%2d.%9lldZ", &year, &month, &day, &hour, &minute, &second,
                  &nanoseconds) != 7) {
    throw FileError(file, "utc: \"" + text + "\" is no time such as 2026-11-22T06:00:00.000000000Z");
  }
  const std::chrono::year_month_day date{std::chrono::year(year), std::chrono::month(month), std::chrono::day(day)};
  if (!date.ok()) throw FileError(file, "utc: \"" + text + "\" is no date");
  return std::chrono::sys_days(date) + std::chrono::hours(hour) + std::chrono::minutes(minute) +
         std::chrono::seconds(second) + std::chrono::nanoseconds(nanoseconds);
}

}  // namespace

fs::path ReferenceFolder(const fs::path& state_folder, int bin_id, const std::string& rig) {
  if (!IsPlainName(rig)) {
    throw std::invalid_argument("rig name \"" + rig +
                                "\": letters, digits, - _ . are allowed, not beginning with a dot");
  }
  return state_folder / "reference" / ("bin" + std::to_string(bin_id)) / rig;
}

bool HasReference(const fs::path& folder) {
  std::error_code error;
  const fs::file_status status = fs::status(folder / kIndexName, error);
  // A folder that may not be read is not the same as an empty one.
  if (status.type() == fs::file_type::none)
    throw FileError(folder / kIndexName, "cannot be looked at: " + error.message());
  return fs::exists(status);
}

Reference LoadReference(const fs::path& folder) {
  const fs::path index_file = folder / kIndexName;
  if (!HasReference(folder)) throw FileError(index_file, "is missing: no reference was taken yet");
  const std::string text = ReadBytes(index_file);
  Reference reference;
  fs::path cloud_file;
  std::string noise_hash;
  try {
    const json index = json::parse(text);
    reference.id = index.at("id").get<std::string>();
    reference.hash = index.at("hash").get<std::string>();
    noise_hash = index.at("noise_hash").get<std::string>();
    reference.rig_hash = index.at("rig_hash").get<std::string>();
    reference.utc = ParseUtc(index_file, index.at("utc").get<std::string>());
    reference.simulated = index.at("simulated").get<bool>();
    cloud_file = folder / index.at("cloud").get<std::string>();
  } catch (const json::exception& error) {
    throw FileError(index_file, std::string("is damaged: ") + error.what());
  }
  PcdCloud cloud = ReadPcd(cloud_file);
  if (cloud.noise_m.empty()) throw FileError(cloud_file, "has no field noise");
  reference.points_in_world = cloud.points;
  reference.noise_m = cloud.noise_m;
  const auto check = [&](const char* what, const std::string& found, const std::string& stored) {
    if (found == stored) return;
    throw FileError(cloud_file, std::string("is damaged: its ") + what + " have the hash " + found + ", " +
                                    index_file.string() + " says " + stored + "; take the reference again");
  };
  check("points", HashOfPoints(reference.points_in_world), reference.hash);
  check("noise figures", HashOfPoints(reference.noise_m), noise_hash);
  return reference;
}

void SaveReference(const Reference& reference, const fs::path& folder) {
  if (!IsPlainName(reference.id)) {
    throw FileError(folder, "the reference's id \"" + reference.id + "\" cannot name a folder");
  }
  const fs::path version = folder / reference.id;
  MakeFolder(version);
  WritePcd(version / kCloudName, reference.points_in_world, reference.noise_m);

  json index{{"id", reference.id},
             {"hash", reference.hash},
             {"noise_hash", HashOfPoints(reference.noise_m)},
             {"rig_hash", reference.rig_hash},
             {"utc", UtcText(reference.utc)},
             {"simulated", reference.simulated},
             {"width", reference.points_in_world.cols},
             {"height", reference.points_in_world.rows},
             {"cloud", kCloudName}};
  WriteBytes(version / kIndexName, index.dump(2) + "\n");
  index["cloud"] = reference.id + "/" + kCloudName;
  WriteBytes(folder / kIndexName, index.dump(2) + "\n");
}

}  // namespace granary
