// Addresses are checked by the very functions that will bind and compare them later (inet_pton), time zones by the
// library that will compute with them: what passes here cannot be refused there for its spelling.
#include "daemon/options.h"

#include <arpa/inet.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <system_error>

#include <date/tz.h>

namespace granary {
namespace {

template <typename Number>
std::optional<Number> ParseWhole(std::string_view digits) {
  Number value{};
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error != std::errc{} || end != digits.data() + digits.size()) return std::nullopt;
  return value;
}

/// An address in network order: 4 bytes or 16.
std::vector<std::uint8_t> ParseAddress(const std::string& text) {
  std::array<std::uint8_t, 16> bytes{};
  if (inet_pton(AF_INET, text.c_str(), bytes.data()) == 1) return {bytes.begin(), bytes.begin() + 4};
  if (inet_pton(AF_INET6, text.c_str(), bytes.data()) == 1) return {bytes.begin(), bytes.end()};
  return {};
}

/// What is wrong with one entry of an allow list; empty when it is well.
std::string NetworkFault(const std::string& network) {
  const std::string wanted = "must be ADDRESS/PREFIX, e.g. 192.168.7.0/24, or 192.168.7.20/32 for one host";
  const auto slash = network.find('/');
  const std::string quoted = "'" + network + "' is no network; ";
  if (slash == std::string::npos) return quoted + wanted;
  std::vector<std::uint8_t> address = ParseAddress(network.substr(0, slash));
  const auto prefix = ParseWhole<unsigned>(std::string_view(network).substr(slash + 1));
  if (address.empty() || !prefix || *prefix > address.size() * 8) return quoted + wanted;
  bool host_bits = false;
  for (std::size_t bit = *prefix; bit < address.size() * 8; ++bit) {
    const auto mask = static_cast<std::uint8_t>(0x80U >> (bit % 8));
    host_bits = host_bits || (address[bit / 8] & mask) != 0;
    address[bit / 8] = static_cast<std::uint8_t>(address[bit / 8] & ~mask);
  }
  if (!host_bits) return {};
  std::array<char, INET6_ADDRSTRLEN> text{};
  inet_ntop(address.size() == 4 ? AF_INET : AF_INET6, address.data(), text.data(), text.size());
  return "'" + network + "' names a host and a network at once; must be " + text.data() + "/" +
         std::to_string(*prefix) + " for the network or /" + std::to_string(address.size() * 8) + " for the host";
}

void AddNetworkFaults(const std::string& key, const std::vector<std::string>& networks,
                      std::vector<std::string>& faults) {
  for (std::size_t i = 0; i < networks.size(); ++i) {
    const std::string words = NetworkFault(networks[i]);
    if (!words.empty()) faults.push_back(key + "[" + std::to_string(i) + "]: " + words);
  }
}

std::string TimeZoneFault(const std::string& name) {
  try {
    static_cast<void>(date::locate_zone(name));
    return {};
  } catch (const std::runtime_error&) {  // the library's words name only the name
    return "'" + name + "' is no time zone known here; must be an IANA name, e.g. Asia/Shanghai or UTC";
  }
}

}  // namespace

std::optional<HostPort> ParseHostPort(std::string_view text) {
  const auto colon = text.rfind(':');
  if (colon == std::string_view::npos) return std::nullopt;
  std::string_view host = text.substr(0, colon);
  const auto port = ParseWhole<std::uint16_t>(text.substr(colon + 1));
  const bool bracketed = host.size() >= 2 && host.front() == '[' && host.back() == ']';
  if (bracketed) host = host.substr(1, host.size() - 2);
  const bool has_colon = host.find(':') != std::string_view::npos;
  // An IPv6 address must be in brackets, and nothing else may be: otherwise "::1:502" has two readings.
  if (!port || *port == 0 || host.empty() || has_colon != bracketed) return std::nullopt;
  if (host.find_first_of(" []/") != std::string_view::npos) return std::nullopt;
  return HostPort{std::string(host), *port};
}

std::string PrintHostPort(const HostPort& end_point) {
  const bool v6 = end_point.host.find(':') != std::string::npos;
  return (v6 ? "[" + end_point.host + "]" : end_point.host) + ":" + std::to_string(end_point.port);
}

std::vector<std::string> Faults(const ScheduleOptions& options) {
  using namespace std::chrono_literals;
  std::vector<std::string> faults;
  if (options.at.empty() && (options.every < 100ms || options.every > 366 * 24h)) {
    faults.emplace_back("every: must be \"100ms\" to \"366d\"");
  }
  if (std::adjacent_find(options.at.begin(), options.at.end(), std::greater_equal<>()) != options.at.end()) {
    faults.emplace_back("at: names a time twice; must be different times of the day");
  }
  if (std::any_of(options.at.begin(), options.at.end(), [](auto time) { return time < 0min || time >= 24h; })) {
    faults.emplace_back("at: must be \"00:00\" to \"23:59\"");
  }
  // The default needs no look into the zone data, so that a machine without tzdata can run an "every" schedule.
  const std::string words = options.timezone == "UTC" ? std::string() : TimeZoneFault(options.timezone);
  if (!words.empty()) faults.push_back("timezone: " + words);
  return faults;
}

std::vector<std::string> Faults(const CycleOptions& options) {
  using namespace std::chrono_literals;
  std::vector<std::string> faults;
  const auto require = [&](bool ok, const char* words) {
    if (!ok) faults.emplace_back(words);
  };
  require(options.attempts >= 1 && options.attempts <= 20, "attempts: must be 1 to 20");
  require(options.retry_delay >= 0ms && options.retry_delay <= 1h, "retry_delay: must be \"0s\" to \"1h\"");
  require(!options.max_rate_m3_h || *options.max_rate_m3_h > 0, "max_rate_m3_h: must be more than 0");
  require(options.stale_after >= 0ms && options.stale_after <= 366 * 24h,
          "stale_after: must be \"0s\" (three times the schedule) to \"366d\"");
  return faults;
}

std::vector<std::string> Faults(const ModbusTcpOptions& options) {
  std::vector<std::string> faults;
  if (ParseAddress(options.host).empty() || options.port == 0) {
    faults.emplace_back("listen: must be ADDRESS:PORT or [IPV6]:PORT, e.g. 0.0.0.0:502 or [::]:502, port 1 to 65535");
  }
  AddNetworkFaults("allow", options.allow, faults);
  AddNetworkFaults("write_allow", options.write_allow, faults);
  if (options.max_clients < 1 || options.max_clients > 1000) faults.emplace_back("max_clients: must be 1 to 1000");
  return faults;
}

std::vector<std::string> Faults(const ModbusTlsOptions& options) {
  std::vector<std::string> faults = Faults(options.tcp);
  if (options.certificate.empty()) faults.emplace_back("certificate: must be a PEM file");
  if (options.key.empty()) faults.emplace_back("key: must be a PEM file");
  if (options.client_ca.empty()) faults.emplace_back("client_ca: must be a PEM file");
  if (std::any_of(options.write_roles.begin(), options.write_roles.end(), [](const auto& r) { return r.empty(); })) {
    faults.emplace_back("write_roles: has an empty role; must be roles as the clients' certificates name them");
  }
  return faults;
}

std::vector<std::string> Faults(const ModbusRtuOptions& options) {
  using namespace std::chrono_literals;
  constexpr std::array kBauds{1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200};
  std::vector<std::string> faults;
  const auto require = [&](bool ok, const char* words) {
    if (!ok) faults.emplace_back(words);
  };
  require(!options.device.empty(), "device: must be a serial port, e.g. /dev/ttyS1");
  require(std::find(kBauds.begin(), kBauds.end(), options.baud) != kBauds.end(),
          "baud: must be 1200, 2400, 4800, 9600, 19200, 38400, 57600 or 115200");
  require(options.parity == "none" || options.parity == "even" || options.parity == "odd",
          "parity: must be none, even or odd");
  require(std::all_of(options.units.begin(), options.units.end(), [](int unit) { return unit >= 1 && unit <= 247; }),
          "units: must be ids of bins, 1 to 247");
  require(options.rts_before >= 0ms && options.rts_before <= 100ms, "rts_before: must be \"0ms\" to \"100ms\"");
  require(options.rts_after >= 0ms && options.rts_after <= 100ms, "rts_after: must be \"0ms\" to \"100ms\"");
  return faults;
}

std::vector<std::string> Faults(const ModbusPlcOptions& options) {
  using namespace std::chrono_literals;
  constexpr int kAddresses = 65536;
  constexpr int kSummaryWords = 65;
  std::vector<std::string> faults;
  const auto require = [&](bool ok, const char* words) {
    if (!ok) faults.emplace_back(words);
  };
  require(ParseHostPort(options.address).has_value(),
          "address: must be HOST:PORT or [IPV6]:PORT, e.g. 192.168.7.20:502, port 1 to 65535");
  require(options.unit >= 0 && options.unit <= 255, "unit: must be 0 to 255");
  // The summary block's 65 registers must fit below the end of the address space.
  require(options.base >= 0 && options.base <= kAddresses - kSummaryWords, "base: must be 0 to 65471");
  require(options.stride >= 1 && options.stride <= 10000, "stride: must be 1 to 10000");
  require(options.heartbeat >= 1s && options.heartbeat <= 1h, "heartbeat: must be \"1s\" to \"1h\"");
  require(options.timeout >= 100ms && options.timeout <= 60s, "timeout: must be \"100ms\" to \"60s\"");
  require(!options.book_base || (*options.book_base >= 0 && *options.book_base <= kAddresses - 4),
          "book_base: must be 0 to 65532");
  require(options.book_every >= 1s && options.book_every <= 24h, "book_every: must be \"1s\" to \"24h\"");
  return faults;
}

std::vector<std::string> Faults(const ModbusOptions& options) {
  // Above 2^24 a float32 skips whole numbers.
  if (options.serial < 0 || options.serial > (1 << 24)) return {"serial: must be 0 to 16777216"};
  return {};
}

}  // namespace granary
