// The verdict comes first: figures that may not be used should not be read first.
#include "daemon/ctl/modbus_poll.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <string>
#include <type_traits>
#include <variant>

#include "config/values.h"
#include "daemon/modbus/status.h"
#include "daemon/record_json.h"
#include "pipeline/types/reason.h"

namespace granary {
namespace {

using Json = nlohmann::ordered_json;

const NamurInfo* NamurOf(std::int64_t code) {
  const auto& table = NamurTable();
  const auto found = std::find_if(table.begin(), table.end(),
                                  [&](const NamurInfo& row) { return static_cast<int>(row.code) == code; });
  return found == table.end() ? nullptr : &*found;
}

const ReasonInfo* ReasonOf(std::int64_t code) {
  const auto& table = ReasonTable();
  const auto found = std::find_if(table.begin(), table.end(),
                                  [&](const ReasonInfo& row) { return static_cast<int>(row.reason) == code; });
  return found == table.end() ? nullptr : &*found;
}

std::vector<std::string> ValidityNames(std::int64_t validity) {
  std::vector<std::string> names;
  for (const BitInfo& bit : ValidityBitTable()) {
    if ((validity >> bit.bit) & 1) names.emplace_back(bit.name);
  }
  return names;
}

std::string OrNone(const std::vector<std::string>& names) { return names.empty() ? "none" : Join(names); }

std::string Line(const char* label, const std::string& words) {
  char start[32];
  std::snprintf(start, sizeof start, "%-9s", label);
  return start + words;
}

/// Seconds since 1970, not a wait.
bool IsTime(const RegisterRow& row) { return row.unit == "s" && row.name.ends_with("_at"); }

Json ToJson(const ReadValue& value) {
  return std::visit(
      [](const auto& held) -> Json {
        if constexpr (std::is_same_v<std::decay_t<decltype(held)>, std::monostate>) {
          return nullptr;
        } else {
          return held;
        }
      },
      value);
}

const char* NameOf(ByteOrder order) {
  constexpr const char* kNames[] = {"ABCD", "CDAB", "DCBA", "BADC"};
  return kNames[static_cast<int>(order)];
}

const char* NameOf(InvalidPolicy policy) {
  constexpr const char* kNames[] = {"hold", "nan", "-9999"};
  return kNames[static_cast<int>(policy)];
}

}  // namespace

std::vector<std::string> Verdict(const Reading& summary) {
  std::vector<std::string> lines;
  lines.push_back(Line("status", OrNone(StatusNames(summary.IntegerOf("status")))));
  const std::int64_t namur = summary.IntegerOf("namur_class"), reason = summary.IntegerOf("reason");
  const NamurInfo* named = NamurOf(namur);
  lines.push_back(
      Line("class", std::to_string(namur) + (named ? " " + std::string(named->name) + ": " + std::string(named->meaning)
                                                   : ", which this program does not know")));
  const ReasonInfo* why = ReasonOf(reason);
  std::string words = std::to_string(reason) + ", which this program does not know";
  if (why) {
    words = std::to_string(reason) + " " + std::string(why->name) + ": " + std::string(why->meaning);
    if (!why->remedy.empty()) words += " " + std::string(why->remedy);
  }
  lines.push_back(Line("reason", words));
  lines.push_back(Line("current", OrNone(ValidityNames(summary.IntegerOf("validity")))));
  lines.push_back(Line("format", std::string(NameOf(summary.format.byte_order)) +
                                     "; figures that are not current: " + NameOf(summary.format.invalid)));
  if (!IsOneSnapshot(summary))
    lines.push_back("NOT ONE SNAPSHOT: registers 5 and 64 differ, so the figures are of two measurements");
  return lines;
}

std::vector<std::string> ValueTable(const Reading& reading) {
  std::vector<std::string> lines{"addr  name                    value           unit"};
  for (const auto& [row, value] : reading.rows) {
    char start[96];
    std::snprintf(start, sizeof start, "%4d  %-22.*s  %-14s  ", row->address, static_cast<int>(row->name.size()),
                  row->name.data(), TextOf(value).c_str());
    std::string line = start + std::string(row->unit);
    if (const auto* seconds = std::get_if<std::int64_t>(&value); seconds && IsTime(*row))
      line += "  " + UtcText(UtcTime(std::chrono::seconds(*seconds)));
    lines.push_back(line);
  }
  return lines;
}

Json ReadingToJson(const Reading& summary, const Reading& reading) {
  const NamurInfo* named = NamurOf(summary.IntegerOf("namur_class"));
  const ReasonInfo* why = ReasonOf(summary.IntegerOf("reason"));
  Json document;
  document["status"] = StatusNames(summary.IntegerOf("status"));
  document["namur_class"] = named ? Json(named->name) : Json();
  document["reason"] = why ? Json(why->name) : Json();
  document["current"] = ValidityNames(summary.IntegerOf("validity"));
  document["byte_order"] = NameOf(summary.format.byte_order);
  document["invalid"] = NameOf(summary.format.invalid);
  document["one_snapshot"] = IsOneSnapshot(summary);
  document["values"] = Json::object();
  for (const auto& [row, value] : reading.rows) document["values"][std::string(row->name)] = ToJson(value);
  return document;
}

bool IsOneSnapshot(const Reading& summary) { return summary.Of("sequence") == summary.Of("sequence_check"); }

}  // namespace granary
