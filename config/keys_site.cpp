// The keys of the whole installation: site, log, Modbus. And what only the whole file can tell: equal bin ids.
#include "config/keys.h"

#include <algorithm>
#include <utility>

#include "daemon/modbus/options.h"

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

/// The keys of a TCP server; `tcp` gives its options in a T.
template <typename T, typename Access>
Key<T> ListenKey(Access tcp, std::string meaning) {
  Key<T> key = Value<T>(
      "listen", [tcp](auto& t) -> auto& { return tcp(t).host; }, "", std::move(meaning));
  key.read = [tcp](const Node& node, T& out) {
    std::string text;
    if (!ReadValue(node, text)) return;
    if (const auto end_point = ParseHostPort(text)) {
      tcp(out).host = end_point->host;
      tcp(out).port = end_point->port;
    } else {
      node.Mismatch();
    }
  };
  key.print = [tcp](const T& value) { return Quote(PrintHostPort({tcp(value).host, tcp(value).port})); };
  return key;
}

template <typename T, typename Access>
std::vector<Key<T>> ClientKeys(Access tcp) {
  return {Value<T>(
              "allow", [tcp](auto& t) -> auto& { return tcp(t).allow; }, "",
              "Networks that may connect. An empty array lets nobody in."),
          Value<T>(
              "write_allow", [tcp](auto& t) -> auto& { return tcp(t).write_allow; }, "",
              "Networks that may also write registers. The default lets nobody."),
          Value<T>(
              "max_clients", [tcp](auto& t) -> auto& { return tcp(t).max_clients; }, "",
              "Connections served at once; one more displaces the longest idle one.")};
}

template <typename T>
std::vector<Key<T>> Joined(std::vector<Key<T>> keys, std::vector<Key<T>> more) {
  for (auto& key : more) keys.push_back(std::move(key));
  return keys;
}

const Section<ModbusTcpOptions>& TcpSection() {
  using T = ModbusTcpOptions;
  const auto tcp = [](auto& t) -> auto& { return t; };
  static const Section<T> section{
      Joined<T>({ListenKey<T>(tcp,
                              "Where the Modbus TCP server listens. Ports below 1024 need the shipped service unit "
                              "(CAP_NET_BIND_SERVICE), the shipped socket unit, or root.")},
                ClientKeys<T>(tcp)),
      [](const T& options) { return Faults(options); }};
  return section;
}

const Section<ModbusTlsOptions>& TlsSection() {
  using T = ModbusTlsOptions;
  const auto tcp = [](auto& t) -> auto& { return t.tcp; };
  static const Section<T> section{
      Joined<T>(
          {ListenKey<T>(tcp, "Where the server for Modbus/TCP Security listens; its usual port is 802."),
           Value<T>("certificate", &T::certificate, "", "PEM file: our certificate and its chain, without the root.")
               .Required(),
           Value<T>("key", &T::key, "", "PEM file: our private key, readable by the daemon alone.").Required(),
           Value<T>("client_ca", &T::client_ca, "", "PEM file: who signs the certificates of clients.").Required(),
           Value<T>("write_roles", &T::write_roles, "",
                    "Roles that may write, as the certificates of clients name them (OID 1.3.6.1.4.1.50316.802.1). "
                    "Empty: write_allow alone decides.")},
          ClientKeys<T>(tcp)),
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
                 "Its parity; one stop bit with even and odd, two with none."),
       Value<T>("units", &T::units, "", "Bins that answer on this line, by id. Empty: all."),
       Value<T>("write", &T::write, "", "Whether the master on this line may write registers."),
       Value<T>("rs485", &T::rs485, "", "Has the kernel's driver switch the transceiver's direction with RTS."),
       Value<T>("rts_on_send", &T::rts_on_send, "", "With rs485: RTS is high while sending; false: low."),
       Value<T>("rts_before", &T::rts_before, "", "With rs485: RTS leads the first byte by this."),
       Value<T>("rts_after", &T::rts_after, "", "With rs485: RTS trails the last byte by this.")},
      [](const T& options) { return Faults(options); }};
  return section;
}

std::vector<std::pair<std::string, ByteOrder>> ByteOrders() {
  return {
      {"ABCD", ByteOrder::kAbcd}, {"CDAB", ByteOrder::kCdab}, {"DCBA", ByteOrder::kDcba}, {"BADC", ByteOrder::kBadc}};
}

const Section<ModbusPlcOptions>& PlcSection() {
  using T = ModbusPlcOptions;
  static const Section<T> section{
      {Value<T>("address", &T::address, "", "The PLC's Modbus TCP server.").Required(),
       Value<T>("unit", &T::unit, "", "Its unit id."),
       Value<T>("base", &T::base, "",
                "Holding register of the PLC where the block of the first bin is written, 0-based."),
       Value<T>("stride", &T::stride, "", "Registers from one bin's block to the next, in the order of the file."),
       Choice<T>("byte_order", &T::byte_order, ByteOrders(), "Order of the bytes of 32-bit values, as the PLC has it."),
       Value<T>(
           "fields", &T::fields, "",
           "Registers that are written, by name and one after the other (granaryctl registers). Empty: the summary, "
           "registers 0 to 64."),
       Value<T>("heartbeat", &T::heartbeat, "",
                "The block is written with every measurement, and after so long anyway."),
       Value<T>("timeout", &T::timeout, "", "For connecting, and for each answer."),
       Value<T>("read_back", &T::read_back, "", "Reads the block back and compares."),
       Value<T>("book_base", &T::book_base, "",
                "Holding register of the PLC with the first bin's book quantity (f32, t) and density (f32, kg/m3), in "
                "byte_order; 4 registers a bin. Unset: not read."),
       Value<T>("book_every", &T::book_every, "", "How often they are read.")},
      [](const T& options) { return Faults(options); }};
  return section;
}

const Section<ModbusOptions>& ModbusSection() {
  using T = ModbusOptions;
  static const Section<T> section{
      {Choice<T>(
           "byte_order", [](auto& t) -> auto& { return t.format.byte_order; }, ByteOrders(),
           "Order of the bytes of 32-bit values in registers 0 to 899, until a client writes register 900."),
       Choice<T>(
           "invalid", [](auto& t) -> auto& { return t.format.invalid; },
           std::vector<std::pair<std::string, InvalidPolicy>>{
               {"hold", InvalidPolicy::kHold}, {"nan", InvalidPolicy::kNan}, {"-9999", InvalidPolicy::kMinus9999}},
           "What a figure reads that is not current: the last good one, a quiet NaN or -9999; until a client "
           "writes register 901."),
       Value<T>("serial", &T::serial, "", "Serial number that the 5708 block shows."),
       Table<T>("tcp", &T::tcp, TcpSection(), "The Modbus TCP server, which SCADA polls."),
       OptionalTable<T>("tls", &T::tls, TlsSection(),
                        "A second server that speaks Modbus/TCP Security: TLS 1.3, certificates on both sides. "
                        "Optional: without the table there is none."),
       OptionalTable<T>("rtu", &T::rtu, RtuSection(),
                        "A Modbus server on a serial line. Optional: without the table there is none."),
       OptionalTable<T>("plc", &T::plc, PlcSection(),
                        "Pushes the summary block to a PLC (client, FC16). Optional: without the table there is "
                        "none.")},
      [](const T& options) { return Faults(options); }};
  return section;
}

/// What no table can tell alone.
std::vector<std::string> WholeFaults(const Config& config) {
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
  if (config.modbus.rtu) {
    for (const int unit : config.modbus.rtu->units) {
      const auto is_bin = [unit](const BinConfig& bin) { return bin.bin.id == unit; };
      if (std::any_of(config.bins.begin(), config.bins.end(), is_bin)) continue;
      faults.push_back("modbus.rtu.units: has " + std::to_string(unit) + ", which is no bin; must be ids of bins");
    }
  }
  if (config.modbus.plc) {
    for (const auto& fault : PlcFaults(*config.modbus.plc, config.bins.size())) {
      faults.push_back("modbus.plc." + fault);
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
       Table<Config>("modbus", &Config::modbus, ModbusSection(), "Modbus servers and clients."),
       Tables<Config>("bin", &Config::bins, BinSection(), "One bin; at least one is needed.")},
      WholeFaults};
  return section;
}

}  // namespace granary
