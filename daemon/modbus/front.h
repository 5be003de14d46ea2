// All that speaks Modbus under one configuration.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "daemon/control.h"
#include "daemon/modbus/plc_client.h"
#include "daemon/modbus/rtu_server.h"
#include "daemon/modbus/server.h"
#include "daemon/modbus/socket.h"
#include "daemon/modbus/tally.h"
#include "daemon/modbus/tls.h"
#include "daemon/modbus/units.h"
#include "daemon/options.h"
#include "pipeline/types/bin.h"

namespace granary {

/// The units with the servers and the client around them. Used by one thread at a time; what it starts has threads of
/// its own, which end with it.
class ModbusFront {
 public:
  /// Reads certificates; serves nobody yet.
  /// @param control borrowed
  /// @throws as LoadTls and PlcClient do
  ModbusFront(const ModbusOptions& options, ModbusIdentity identity, const std::vector<Bin>& bins, BinControl& control);

  /// Where snapshots go; owned here.
  [[nodiscard]] std::vector<Publisher*> Publishers();
  [[nodiscard]] ModbusUnits& units() { return units_; }

  /// Starts the TCP server, and the TLS server where one is configured.
  /// @param tcp, tls listening sockets @throws as ModbusServer does
  void Listen(FileDescriptor tcp, FileDescriptor tls);
  /// Starts the server on the serial line, where one is configured; a port that is not there is waited for.
  /// @throws std::invalid_argument as RtuServer does
  void OpenLine();
  /// Ends it: a serial port is held by one at a time.
  void CloseLine() { rtu_.reset(); }

  [[nodiscard]] std::uint16_t Port() const { return tcp_->Port(); }

 private:
  const ModbusOptions options_;
  ModbusTally tally_;
  ModbusUnits units_;
  std::shared_ptr<const TlsContext> tls_context_;
  std::unique_ptr<PlcClient> plc_;
  std::unique_ptr<ModbusServer> tcp_, tls_;
  std::unique_ptr<RtuServer> rtu_;
};

}  // namespace granary
