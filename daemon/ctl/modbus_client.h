// A Modbus TCP client, for looking at one's own server through another's eyes.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "daemon/options.h"

struct _modbus;  // libmodbus' modbus_t

namespace granary {

/// The server cannot be reached, does not answer, or answers with an exception; what() names which and what to look at.
class ModbusClientError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// One connection of libmodbus, so that what reads our registers is not what writes them. Not thread-safe. After an
/// error the connection is not used again: a late answer would be taken for the next one's.
class ModbusClient {
 public:
  /// Connects. May block for the look-up of a name and for `timeout`.
  /// @param unit 0…247 or 255
  /// @param where_from tells the reader of an error where the address came from
  /// @throws ModbusClientError
  ModbusClient(HostPort address, int unit, const std::string& where_from,
               std::chrono::milliseconds timeout = std::chrono::seconds(3));

  /// Reads holding registers (FC3) in blocks of at most 125.
  /// @throws ModbusClientError
  [[nodiscard]] std::vector<std::uint16_t> Read(int first, int count);

 private:
  struct Free {
    void operator()(_modbus* client) const;
  };

  HostPort address_;
  int unit_;
  std::unique_ptr<_modbus, Free> client_;
  bool has_answered_ = false;
};

}  // namespace granary
