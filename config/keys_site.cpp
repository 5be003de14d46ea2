// The keys of the whole installation: site, log, Modbus. And what only the whole file can tell: equal bin ids.
#include "config/keys.h"

namespace granary {
namespace {

const Section<Config>& SiteSection() {
  static const Section<Config> section{
      {Value<Config>("name", &Config::site_name, "", "The installation's name, in logs and Modbus identity.")
           .Allowed("any text")},
      nullptr};
  return section;
}

const Section<Config>& LogSection() {
  static const Section<Config> section{
      {Choice<Config>(
          "level", &Config::log_level,
          std::vector<std::pair<std::string, std::string>>{
              {"trace", "trace"}, {"debug", "debug"}, {"info", "info"}, {"warn", "warn"}, {"error", "error"}},
          "Least severe message that is logged (to standard output, hence the journal).")},
      nullptr};
  return section;
}

Key<ModbusTcpOptions> ListenKey() {
  Key<ModbusTcpOptions> key = Value<ModbusTcpOptions>("listen", &ModbusTcpOptions::host, "",
                                                      "Where the Modbus TCP server listens. Ports below 1024 need the "
                                                      "shipped service unit (CAP_NET_BIND_SERVICE) or root.");
  key.read = [](const Node& node, ModbusTcpOptions& out) {
    std::string text;
    if (!ReadValue(node, text)) return;
    if (const auto end_point = ParseHostPort(text)) {
      out.host = end_point->host;
      out.port = end_point->port;
    } else {
      node.Mismatch();
    }
  };
  key.print = [](const ModbusTcpOptions& tcp) { return Quote(PrintHostPort({tcp.host, tcp.port})); };
  return key;
}

const Section<ModbusTcpOptions>& TcpSection() {
  using T = ModbusTcpOptions;
  static const Section<T> section{
      {ListenKey(), Value<T>("allow", &T::allow, "", "Networks that may connect. An empty array lets nobody in."),
       Value<T>("write_allow", &T::write_allow, "", "Networks that may also write registers. The default lets nobody."),
       Value<T>("max_clients", &T::max_clients, "",
                "Connections served at once; one more displaces the longest idle one.")},
      [](const T& options) { return Faults(options); }};
  return section;
}

const Section<ModbusRtuOptions>& RtuSection() {
  using T = ModbusRtuOptions;
  static const Section<T> section{
      {Value<T>("device", &T::device, "", "The serial port.").Required(),
       Value<T>("baud", &T::baud, "bit/s", "Its speed."),
       Choice<T>("parity", &T::parity,
                 std::vector<std::pair<std::string, std::string>>{{"none", "none"}, {"even", "even"}, {"odd", "odd"}},
                 "Its parity; one stop bit with even and odd, two with none.")},
      [](const T& options) { return Faults(options); }};
  return section;
}

const Section<ModbusPlcOptions>& PlcSection() {
  using T = ModbusPlcOptions;
  static const Section<T> section{
      {Value<T>("address", &T::address, "", "The PLC's Modbus TCP server.").Required(),
       Value<T>("unit", &T::unit, "", "Its unit id."),
       Value<T>("base", &T::base, "", "Holding register of the PLC where the summary block is written, 0-based.")},
      [](const T& options) { return Faults(options); }};
  return section;
}

const Section<Config>& ModbusSection() {
  static const Section<Config> section{
      {Table<Config>("tcp", &Config::modbus_tcp, TcpSection(), "The Modbus TCP server, which SCADA polls."),
       OptionalTable<Config>("rtu", &Config::modbus_rtu, RtuSection(),
                             "A second Modbus server, on a serial line. Optional: without the table there is none."),
       OptionalTable<Config>("plc", &Config::modbus_plc, PlcSection(),
                             "Pushes the summary block to a PLC (client, FC16). Optional: without the table there is "
                             "none.")},
      nullptr};
  return section;
}

std::vector<std::string> BinFaults(const Config& config) {
  std::vector<std::string> faults;
  if (config.bins.empty()) faults.emplace_back("bin: is missing; must be at least one [[bin]]");
  for (std::size_t i = 0; i < config.bins.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const int id = config.bins[i].bin.id;
      if (id != config.bins[j].bin.id) continue;
      faults.push_back("bin[" + std::to_string(i) + "].id: is " + std::to_string(id) + ", which is bin[" +
                       std::to_string(j) + "]'s already; must be unique, 1 to 247");
      break;
    }
  }
  return faults;
}

auto Whole() {
  return [](auto& config) -> auto& { return config; };
}

}  // namespace

const Section<Config>& ConfigSection() {
  static const Section<Config> section{
      {Table<Config>("site", Whole(), SiteSection(), "The installation."),
       Table<Config>("log", Whole(), LogSection(), "What is logged."),
       Table<Config>("modbus", Whole(), ModbusSection(), "Modbus servers and clients."),
       Tables<Config>("bin", &Config::bins, BinSection(), "One bin; at least one is needed.")},
      BinFaults};
  return section;
}

}  // namespace granary
