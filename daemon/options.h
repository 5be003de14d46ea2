// What the daemon does around the measuring: when, for whom, how it publishes.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
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

/// Whose book data win: what a client committed last (the file's until then), or the file's always.
enum class BookSource : std::uint8_t { kRegisters, kFile };

/// What the configuration says of one bin.
struct BinConfig {
  Bin bin;
  Inventory inventory;
  BookSource book_source = BookSource::kRegisters;
  ScheduleOptions schedule;
  CycleOptions cycle;
  int shots = 1;  ///< pairs of frames a rig that are fused into one measurement
  PipelineOptions pipeline;
  std::vector<RigOptions> rigs;
};

/// Order of the four bytes of a 32-bit register value; the numbers are register 900's. 16-bit values and text are as
/// Modbus has them in every order.
enum class ByteOrder : std::uint16_t { kAbcd = 0, kCdab = 1, kDcba = 2, kBadc = 3 };

/// What the registers show for a figure that is not current; the numbers are register 901's.
enum class InvalidPolicy : std::uint16_t { kHold = 0, kNan = 1, kMinus9999 = 2 };

/// How the registers 0–899 of one bin are written out.
struct RegisterFormat {
  ByteOrder byte_order = ByteOrder::kAbcd;
  InvalidPolicy invalid = InvalidPolicy::kHold;
  bool operator==(const RegisterFormat&) const = default;
};

struct ModbusTcpOptions {
  std::string host = "127.0.0.1";
  std::uint16_t port = 1502;
  std::vector<std::string> allow{"127.0.0.0/8", "::1/128"};  ///< CIDR; who may connect
  std::vector<std::string> write_allow;                      ///< CIDR; who may write registers
  int max_clients = 32;
};

/// Modbus/TCP Security: TLS 1.3, both sides show certificates.
struct ModbusTlsOptions {
  ModbusTcpOptions tcp{.host = "127.0.0.1", .port = 802, .allow = {"127.0.0.0/8", "::1/128"}, .write_allow = {}};
  std::filesystem::path certificate;     ///< PEM, ours, with the chain up to but without the root
  std::filesystem::path key;             ///< PEM, readable by the daemon only
  std::filesystem::path client_ca;       ///< PEM, one or several; who signs the clients' certificates
  std::vector<std::string> write_roles;  ///< roles in the clients' certificates that may write; empty: not asked for
};

struct ModbusRtuOptions {
  std::string device;
  int baud = 19200;
  std::string parity = "even";  ///< none | even | odd
  std::vector<int> units;       ///< bins that answer on this line; empty: all
  bool write = false;           ///< whether the master on this line may write registers
  bool rs485 = false;           ///< the kernel's driver switches the transceiver's direction (TIOCSRS485)
  bool rts_on_send = true;      ///< with rs485: RTS is high while sending; false: low
  std::chrono::milliseconds rts_before{0}, rts_after{0};  ///< with rs485: RTS leads and trails the data by these
};

struct ModbusPlcOptions {
  std::string address;  ///< host:port
  int unit = 1;
  int base = 0;      ///< holding register of the PLC where the first bin's block is written
  int stride = 100;  ///< from one bin's block to the next, in the order of the file
  ByteOrder byte_order = ByteOrder::kAbcd;
  std::vector<std::string> fields;  ///< names of registers, one after the other; empty: the summary, registers 0–64
  std::chrono::milliseconds heartbeat{10000};  ///< pushed again after so long without a measurement
  std::chrono::milliseconds timeout{1000};     ///< for connecting, and for each answer
  bool read_back = false;                      ///< read what was written and compare
  std::optional<int> book_base;  ///< holding register of the PLC with book quantity (f32, t) and density (f32, kg/m³)
  std::chrono::milliseconds book_every{60000};  ///< how often they are read
};

/// Everything that speaks Modbus.
struct ModbusOptions {
  RegisterFormat format;  ///< until a client writes registers 900 and 901
  int serial = 0;         ///< serial number in the 5708 block
  ModbusTcpOptions tcp;
  std::optional<ModbusTlsOptions> tls;
  std::optional<ModbusRtuOptions> rtu;
  std::optional<ModbusPlcOptions> plc;
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
[[nodiscard]] std::vector<std::string> Faults(const ModbusTlsOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const ModbusRtuOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const ModbusPlcOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const ModbusOptions& options);

}  // namespace granary
