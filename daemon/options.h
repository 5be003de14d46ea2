// What the daemon does around the measuring: when, for whom, how it publishes.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/options.h"
#include "pipeline/options.h"
#include "pipeline/types/bin.h"

namespace granary {

/// When a bin is measured: every so often, or at times of the day.
struct ScheduleOptions {
  std::chrono::milliseconds every{std::chrono::minutes{30}};  ///< used when `at` is empty; at least 100 ms
  std::vector<std::chrono::minutes> at;                       ///< minutes since local midnight, ascending
  std::string timezone = "UTC";                               ///< IANA name, for `at`
};

/// Gates and repeats of one cycle.
struct CycleOptions {
  int attempts = 3;  ///< captures tried before the last good value is held
  std::chrono::milliseconds retry_delay{2000};
  std::optional<double> max_rate_m3_h;       ///< a faster change of volume is implausible; empty: no gate
  std::chrono::milliseconds stale_after{0};  ///< age at which a figure is stale; 0: three times the schedule
};

/// What the configuration says of one bin.
struct BinConfig {
  Bin bin;
  Inventory inventory;
  ScheduleOptions schedule;
  CycleOptions cycle;
  int shots = 1;  ///< pairs of frames a rig that are fused into one measurement
  PipelineOptions pipeline;
  std::vector<RigOptions> rigs;
};

struct ModbusTcpOptions {
  std::string host = "127.0.0.1";
  std::uint16_t port = 1502;
  std::vector<std::string> allow{"127.0.0.0/8", "::1/128"};  ///< CIDR; who may connect
  std::vector<std::string> write_allow;                      ///< CIDR; who may write registers
  int max_clients = 32;
};

struct ModbusRtuOptions {
  std::string device;
  int baud = 19200;
  std::string parity = "even";  ///< none | even | odd
};

struct ModbusPlcOptions {
  std::string address;  ///< host:port
  int unit = 1;
  int base = 0;  ///< holding register of the PLC where the summary block is written
};

/// A TCP end point.
struct HostPort {
  std::string host;  ///< name or address, an IPv6 address without its brackets
  std::uint16_t port = 0;
};

/// Splits "host:port" or "[v6 address]:port". @return empty when it is neither, or the port is not 1…65535.
[[nodiscard]] std::optional<HostPort> ParseHostPort(std::string_view text);
/// The inverse: brackets an IPv6 address.
[[nodiscard]] std::string PrintHostPort(const HostPort& end_point);

/// What is wrong with the options: one "key: what, what is allowed" each; empty when all is well.
[[nodiscard]] std::vector<std::string> Faults(const ScheduleOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const CycleOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const ModbusTcpOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const ModbusRtuOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const ModbusPlcOptions& options);

}  // namespace granary
