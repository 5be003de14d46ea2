// A serial port for Modbus RTU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>

#include <linux/serial.h>

#include "daemon/modbus/socket.h"
#include "daemon/options.h"

namespace granary {

/// Names the device, what was done with it, and the system's own words.
class SerialError : public std::runtime_error {
 public:
  /// @param code errno; 0 where the system has none
  SerialError(const std::string& device, const std::string& what, int code);
  [[nodiscard]] int Code() const { return code_; }

 private:
  int code_;
};

/// An open port: raw, 8 data bits, one stop bit with parity and two without, no flow control, ours alone. Not
/// thread-safe.
class SerialPort {
 public:
  /// @throws SerialError when the device is missing, busy or no serial port, or does not take the options
  explicit SerialPort(const ModbusRtuOptions& options);
  ~SerialPort();
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;

  /// For poll.
  [[nodiscard]] int Descriptor() const { return port_.Get(); }
  /// What has arrived, up to `room`; never blocks. @return bytes read, 0 when there are none
  /// @throws SerialError when the port is gone
  [[nodiscard]] std::size_t Read(std::span<std::uint8_t> room);
  /// Whether bytes have arrived that are not read yet.
  [[nodiscard]] bool HasInput() const;
  /// Returns when the last byte is on the line. @throws SerialError when the port is gone or takes nothing for a second
  void Send(std::span<const std::uint8_t> bytes);

 private:
  std::string device_;
  FileDescriptor port_;
};

/// The RS-485 settings that the kernel's driver is asked for.
[[nodiscard]] serial_rs485 Rs485Of(const ModbusRtuOptions& options);
/// Which of the keys the driver has not taken, in words; empty when it has taken all.
[[nodiscard]] std::string Rs485Refused(const serial_rs485& asked, const serial_rs485& taken);

}  // namespace granary
