// Each form is what its program documents, filled from the one table, so that a new register is there everywhere.
// Sources: Telegraf's plugins/inputs/modbus/README.md (request style); node-red-contrib-modbus 5.45's node defaults;
// Inductive Automation's "Modbus Addressing" and the column names of Ignition's CSV importer.
#include "daemon/ctl/registers_scada.h"

#include <ostream>
#include <string>
#include <string_view>
#include <utility>

#include <nlohmann/json.hpp>

#include "daemon/modbus/registers.h"
#include "daemon/modbus/status.h"
#include "pipeline/types/reason.h"

namespace granary {
namespace {

constexpr int kSummaryEnd = 100, kDiagnosticsBegin = 200, kDiagnosticsEnd = 300;

std::string_view TelegrafType(RegisterType type) {
  switch (type) {
    case RegisterType::kU16:
      return "UINT16";
    case RegisterType::kU32:
      return "UINT32";
    case RegisterType::kI32:
      return "INT32";
    case RegisterType::kF32:
      return "FLOAT32";
    case RegisterType::kAscii:
    case RegisterType::kMirror:
      break;
  }
  return {};
}

/// Telegraf cuts a request where addresses are missing: the gaps are asked for and left out.
void PrintTelegrafRequest(std::ostream& out, int unit, int first, int end) {
  out << "\n  [[inputs.modbus.request]]\n    slave_id = " << unit
      << "\n    byte_order = \"ABCD\"\n    register = \"holding\"\n    measurement = \"granary\"\n    fields = [\n";
  int next = first;
  for (const auto& row : RegisterTable()) {
    if (row.address < first || row.address >= end) continue;
    for (; next < row.address; ++next) out << "      { address = " << next << ", type = \"UINT16\", omit = true },\n";
    out << "      { address = " << row.address << ", name = \"" << row.name << "\", type = \"" << TelegrafType(row.type)
        << "\" },\n";
    next = row.address + row.words;
  }
  out << "    ]\n    [inputs.modbus.request.tags]\n      bin = \"" << unit << "\"\n";
}

/// The body of the function node; `registers` comes before it.
constexpr std::string_view kNodeRedDecoder = R"(
const bytes = Buffer.alloc(2 * msg.payload.length);
msg.payload.forEach((word, i) => bytes.writeUInt16BE(word, 2 * i));
const read = {
  u16: at => bytes.readUInt16BE(2 * at),
  u32: at => bytes.readUInt32BE(2 * at),
  f32: at => bytes.readFloatBE(2 * at),
};
const values = {};
for (const [address, type, name, unit] of registers) {
  let value = read[type](address);
  if (type === "f32") value = Number.isFinite(value) ? Number(value.toPrecision(7)) : null;
  if (unit === "s" && value === (type === "u16" ? 65535 : 4294967295)) value = null;
  values[name] = value;
}
if (values.sequence !== values.sequence_check) {
  node.error("registers 5 and 64 differ: not one read", msg);
  return null;
}
values.status_bits = statusBits.filter((name, bit) => values.status >> bit & 1);
values.reason_name = reasons[values.reason] ?? "unknown";
node.status({ text: values.volume + " m3, " + values.error_rate + " %, " + values.status_bits.join(" ") });
msg.payload = values;
return msg;
)";

std::string NodeRedFunction() {
  using Json = nlohmann::ordered_json;
  std::string text = "// Registers 0 to 64, 32-bit values high word first (register 900 = 0).\nconst registers = [\n";
  for (const auto& row : RegisterTable()) {
    if (row.address >= kSummaryEnd) break;
    text += "  " + Json{row.address, NameOf(row.type), row.name, row.unit}.dump() + ",\n";
  }
  Json bits = Json::array(), reasons = Json::object();
  for (const auto& bit : StatusBitTable()) bits.push_back(bit.name);
  for (const auto& row : ReasonTable()) reasons[std::to_string(static_cast<int>(row.reason))] = row.name;
  return text + "];\nconst statusBits = " + bits.dump() + ";\nconst reasons = " + reasons.dump() + ";\n" +
         std::string(kNodeRedDecoder.substr(1));
}

int SummaryWords() {
  int words = 0;
  for (const auto& row : RegisterTable()) {
    if (row.address < kSummaryEnd) words = row.address + row.words;
  }
  return words;
}

std::string InAscii(std::string_view text) {
  constexpr std::pair<std::string_view, std::string_view> kPlain[] = {{"³", "3"}, {"°", "deg"}, {"µ", "u"},  {"·", "*"},
                                                                      {"−", "-"}, {"–", "-"},   {"…", "..."}};
  std::string plain(text);
  for (const auto& [from, to] : kPlain) {
    for (auto at = plain.find(from); at != std::string::npos; at = plain.find(from, at + to.size()))
      plain.replace(at, from.size(), to);
  }
  return plain;
}

struct IgnitionType {
  std::string designator;  ///< before the address, with the length of a text after it
  int data_type;           ///< 2 Int4, 3 Int8, 4 Float4, 7 String
};

IgnitionType IgnitionTypeOf(const RegisterRow& row) {
  const std::string address = std::to_string(row.address);
  switch (row.type) {
    case RegisterType::kU16:
      return {"HRUS" + address, 2};
    case RegisterType::kU32:
      return {"HRUI" + address, 3};
    case RegisterType::kI32:
      return {"HRI" + address, 2};
    case RegisterType::kF32:
      return {"HRF" + address, 4};
    case RegisterType::kAscii:
      return {"HRS" + address + ":" + std::to_string(2 * row.words), 7};
    case RegisterType::kMirror:
      break;
  }
  return {};
}

}  // namespace

void PrintTelegraf(std::ostream& out, int unit) {
  out << "# Made by `granaryctl registers --format telegraf`. Telegraf 1.21 or newer.\n"
         "# One [[inputs.modbus]] a granaryd; for another bin repeat the requests with its id as slave_id.\n"
         "[[inputs.modbus]]\n"
         "  name = \"granary\"\n"
         "  controller = \"tcp://127.0.0.1:1502\"\n"
         "  timeout = \"1s\"\n"
         "  configuration_type = \"request\"\n";
  PrintTelegrafRequest(out, unit, 0, kSummaryEnd);
  PrintTelegrafRequest(out, unit, kDiagnosticsBegin, kDiagnosticsEnd);
}

void PrintNodeRed(std::ostream& out, int unit) {
  using Json = nlohmann::ordered_json;
  const std::string tab = "6772616e61727901", client = "6772616e61727902", read = "6772616e61727903",
                    decode = "6772616e61727904", debug = "6772616e61727905";
  Json flow = Json::array();
  flow.push_back({{"id", tab},
                  {"type", "tab"},
                  {"label", "Granary"},
                  {"disabled", false},
                  {"info",
                   "Made by granaryctl registers --format node-red. Needs node-red-contrib-modbus. Set host and "
                   "port in the node granaryd."}});
  flow.push_back({{"id", client},
                  {"type", "modbus-client"},
                  {"name", "granaryd"},
                  {"clienttype", "tcp"},
                  {"bufferCommands", true},
                  {"stateLogEnabled", false},
                  {"queueLogEnabled", false},
                  {"failureLogEnabled", true},
                  {"tcpHost", "127.0.0.1"},
                  {"tcpPort", "1502"},
                  {"tcpType", "DEFAULT"},
                  {"serialPort", "/dev/ttyUSB"},
                  {"serialType", "RTU-BUFFERD"},
                  {"serialBaudrate", "9600"},
                  {"serialDatabits", "8"},
                  {"serialStopbits", "1"},
                  {"serialParity", "none"},
                  {"serialConnectionDelay", "100"},
                  {"serialAsciiResponseStartDelimiter", "0x3A"},
                  {"unit_id", std::to_string(unit)},
                  {"commandDelay", "1"},
                  {"clientTimeout", "1000"},
                  {"reconnectOnTimeout", true},
                  {"reconnectTimeout", "2000"},
                  {"parallelUnitIdsAllowed", true}});
  flow.push_back({{"id", read},
                  {"type", "modbus-read"},
                  {"z", tab},
                  {"name", "summary"},
                  {"topic", "granary/" + std::to_string(unit)},
                  {"showStatusActivities", true},
                  {"logIOActivities", false},
                  {"showErrors", true},
                  {"showWarnings", true},
                  {"unitid", std::to_string(unit)},
                  {"dataType", "HoldingRegister"},
                  {"adr", "0"},
                  {"quantity", std::to_string(SummaryWords())},
                  {"rate", "1"},
                  {"rateUnit", "s"},
                  {"delayOnStart", false},
                  {"enableDeformedMessages", false},
                  {"startDelayTime", ""},
                  {"server", client},
                  {"useIOFile", false},
                  {"ioFile", ""},
                  {"useIOForPayload", false},
                  {"emptyMsgOnFail", false},
                  {"x", 120},
                  {"y", 80},
                  {"wires", {{decode}, Json::array()}}});
  flow.push_back({{"id", decode},
                  {"type", "function"},
                  {"z", tab},
                  {"name", "names and values"},
                  {"func", NodeRedFunction()},
                  {"outputs", 1},
                  {"timeout", 0},
                  {"noerr", 0},
                  {"initialize", ""},
                  {"finalize", ""},
                  {"libs", Json::array()},
                  {"x", 330},
                  {"y", 80},
                  {"wires", Json::array({Json::array({debug})})}});
  flow.push_back({{"id", debug},
                  {"type", "debug"},
                  {"z", tab},
                  {"name", "granary"},
                  {"active", true},
                  {"tosidebar", true},
                  {"console", false},
                  {"tostatus", false},
                  {"complete", "payload"},
                  {"targetType", "msg"},
                  {"x", 540},
                  {"y", 80},
                  {"wires", Json::array()}});
  out << flow.dump(2) << "\n";
}

void PrintIgnition(std::ostream& out, int unit) {
  out << "Path,Name,Owner,TagType,DataType,Value,Enabled,AccessRights,OPCServer,OPCItemPath,EngUnit,Documentation\n"
         "# version=1,,,,,,,,,,,\n";
  for (const auto& row : RegisterTable()) {
    if (row.type == RegisterType::kMirror) continue;
    const IgnitionType type = IgnitionTypeOf(row);
    out << "," << row.name << ",,0," << type.data_type << ",,TRUE,"
        << (row.access == RegisterAccess::kReadWrite ? "Read_Write" : "Read_Only")
        << ",Ignition OPC UA Server,[granary]" << unit << "." << type.designator << "," << CsvField(InAscii(row.unit))
        << "," << CsvField(InAscii(row.meaning)) << "\n";
  }
}

std::string CsvField(std::string_view text) {
  if (text.find_first_of(",\"\n") == std::string_view::npos) return std::string(text);
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

}  // namespace granary
