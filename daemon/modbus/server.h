// The Modbus TCP server, plain or with TLS.
#pragma once

#include <cstdint>
#include <memory>
#include <thread>

#include "daemon/modbus/connection.h"
#include "daemon/modbus/socket.h"
#include "daemon/modbus/tally.h"
#include "daemon/modbus/tls.h"
#include "daemon/modbus/units.h"
#include "daemon/options.h"

namespace granary {

/// Serves the units from one thread of its own, from construction to destruction. Every member may be called from any
/// thread; none blocks on a client.
class ModbusServer {
 public:
  /// @param listener a listening TCP socket: from ListenTcp, or inherited (systemd)
  /// @param options `allow`, `write_allow` and `max_clients` are used; host and port are the listener's
  /// @param units, tally borrowed
  /// @param tls empty for a server in the clear
  /// @throws std::invalid_argument for a network that is no CIDR; std::runtime_error when `listener` does not listen
  ModbusServer(FileDescriptor listener, const ModbusTcpOptions& options, ModbusUnits& units, ModbusTally& tally,
               ModbusLimits limits = {}, std::shared_ptr<const TlsContext> tls = nullptr);
  ~ModbusServer();
  ModbusServer(const ModbusServer&) = delete;
  ModbusServer& operator=(const ModbusServer&) = delete;

  [[nodiscard]] std::uint16_t Port() const { return port_; }

 private:
  class Loop;

  const std::uint16_t port_;
  std::unique_ptr<Loop> loop_;
  std::jthread thread_;  // last: stopped and joined before anything that it uses goes
};

}  // namespace granary
