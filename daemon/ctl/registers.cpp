// Every form of the map is made from the same tables that the server encodes from, so that no manual can disagree
// with the wire.
#include "daemon/ctl/registers.h"

#include <algorithm>
#include <cstddef>
#include <iomanip>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "daemon/ctl/registers_scada.h"
#include "daemon/modbus/registers.h"
#include "daemon/modbus/status.h"
#include "pipeline/types/reason.h"

namespace granary {
namespace {

std::string TypeOf(const RegisterRow& row) {
  std::string type(NameOf(row.type));
  if (row.type == RegisterType::kAscii) type.append("[").append(std::to_string(2 * row.words)).append("]");
  return type;
}

/// "r" or "rw".
std::string_view AccessOf(const RegisterRow& row) { return row.access == RegisterAccess::kReadWrite ? "rw" : "r"; }

/// Columns a person sees: UTF-8 continuation bytes take none.
std::size_t Width(std::string_view text) {
  return static_cast<std::size_t>(std::count_if(
      text.begin(), text.end(), [](char byte) { return (static_cast<unsigned char>(byte) & 0xC0) != 0x80; }));
}

std::string Padded(std::string_view text, std::size_t width) {
  return std::string(text) + std::string(width - std::min(width, Width(text)), ' ');
}

void PrintText(std::ostream& out) {
  out << "addr  type       name                    unit          meaning\n";
  for (const auto& row : RegisterTable()) {
    out << std::setw(4) << row.address << "  " << Padded(TypeOf(row), 9) << "  " << Padded(row.name, 22) << "  "
        << Padded(row.unit, 8) << "  " << Padded(AccessOf(row), 2) << "  " << row.meaning << "\n";
  }
  const auto bits = [&](std::string_view title, const auto& table) {
    out << "\n" << title << "\n";
    for (const auto& bit : table) {
      out << std::setw(4) << bit.bit << "  " << Padded(bit.name, 20) << "  " << bit.meaning << "\n";
    }
  };
  bits("Bits of the status word (0); discrete inputs 0-15", StatusBitTable());
  bits("Bits of the validity word (3)", ValidityBitTable());
  bits("Alarm bits (52 active, 54 latched); active ones are discrete inputs 16-47", AlarmBitTable());
  out << "\nNAMUR NE 107 class (1)\n";
  for (const auto& row : NamurTable()) {
    out << std::setw(4) << static_cast<int>(row.code) << "  " << Padded(row.name, 20) << "  " << row.meaning << "\n";
  }
  out << "\nReason codes (2, 56)\n";
  for (const auto& row : ReasonTable()) {
    out << std::setw(4) << static_cast<int>(row.reason) << "  " << Padded(row.name, 21) << "  " << row.meaning
        << (row.remedy.empty() ? "" : " ") << row.remedy << "\n";
  }
}

void PrintCsv(std::ostream& out) {
  out << "address,type,words,name,unit,access,meaning\n";
  for (const auto& row : RegisterTable()) {
    out << row.address << "," << NameOf(row.type) << "," << row.words << "," << CsvField(row.name) << ","
        << CsvField(row.unit) << "," << AccessOf(row) << "," << CsvField(row.meaning) << "\n";
  }
}

void PrintJson(std::ostream& out) {
  using Json = nlohmann::ordered_json;
  const auto bits = [](const auto& table) {
    Json rows = Json::array();
    for (const auto& bit : table) rows.push_back({{"bit", bit.bit}, {"name", bit.name}, {"meaning", bit.meaning}});
    return rows;
  };
  Json map;
  map["map_version"] = kMapVersion;
  map["float_order"] = "ABCD";
  map["registers"] = Json::array();
  for (const auto& row : RegisterTable()) {
    map["registers"].push_back({{"address", row.address},
                                {"type", NameOf(row.type)},
                                {"words", row.words},
                                {"name", row.name},
                                {"unit", row.unit},
                                {"access", AccessOf(row)},
                                {"meaning", row.meaning}});
  }
  map["status_bits"] = bits(StatusBitTable());
  map["validity_bits"] = bits(ValidityBitTable());
  map["alarm_bits"] = bits(AlarmBitTable());
  map["namur_classes"] = Json::array();
  for (const auto& row : NamurTable()) {
    map["namur_classes"].push_back(
        {{"code", static_cast<int>(row.code)}, {"name", row.name}, {"meaning", row.meaning}});
  }
  map["reasons"] = Json::array();
  for (const auto& row : ReasonTable()) {
    map["reasons"].push_back(
        {{"code", static_cast<int>(row.reason)}, {"name", row.name}, {"meaning", row.meaning}, {"remedy", row.remedy}});
  }
  out << map.dump(2) << "\n";
}

void PrintMarkdown(std::ostream& out) {
  out << "| addr | type | name | unit | | meaning |\n| ---: | --- | --- | --- | --- | --- |\n";
  for (const auto& row : RegisterTable()) {
    out << "| " << row.address << " | " << TypeOf(row) << " | `" << row.name << "` | " << row.unit << " | "
        << AccessOf(row) << " | " << row.meaning << " |\n";
  }
  const auto bits = [&](std::string_view title, const auto& table) {
    out << "\n" << title << "\n\n| bit | name | when on |\n| ---: | --- | --- |\n";
    for (const auto& bit : table) out << "| " << bit.bit << " | `" << bit.name << "` | " << bit.meaning << " |\n";
  };
  bits("### Status word (register 0, discrete inputs 0–15)", StatusBitTable());
  bits("### Validity bits (register 3)", ValidityBitTable());
  bits("### Alarm bits (registers 52 and 54; active ones are discrete inputs 16–47)", AlarmBitTable());
  out << "\n### NAMUR NE 107 class (register 1)\n\n| class | name | meaning |\n| ---: | --- | --- |\n";
  for (const auto& row : NamurTable()) {
    out << "| " << static_cast<int>(row.code) << " | `" << row.name << "` | " << row.meaning << " |\n";
  }
  out << "\n### Reason codes (registers 2 and 56)\n\n| code | name | meaning | what to do |\n| ---: | --- | --- | --- "
         "|\n";
  for (const auto& row : ReasonTable()) {
    out << "| " << static_cast<int>(row.reason) << " | `" << row.name << "` | " << row.meaning << " | " << row.remedy
        << " |\n";
  }
}

}  // namespace

const std::vector<std::string>& RegisterFormats() {
  static const std::vector<std::string> formats{"text", "csv", "json", "markdown", "telegraf", "node-red", "ignition"};
  return formats;
}

int RunRegisters(std::string_view format, std::ostream& out, std::ostream& err, int unit) {
  if (format == "text") {
    PrintText(out);
  } else if (format == "csv") {
    PrintCsv(out);
  } else if (format == "json") {
    PrintJson(out);
  } else if (format == "markdown") {
    PrintMarkdown(out);
  } else if (format == "telegraf") {
    PrintTelegraf(out, unit);
  } else if (format == "node-red") {
    PrintNodeRed(out, unit);
  } else if (format == "ignition") {
    PrintIgnition(out, unit);
  } else {
    err << "registers: \"" << format << "\" is no format;";
    for (const auto& known : RegisterFormats()) err << " " << known;
    err << " are\n";
    return 2;
  }
  return 0;
}

}  // namespace granary
