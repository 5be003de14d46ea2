// A server of one measured bin, with all that it borrows.
#pragma once

#include <cstdint>
#include <memory>
#include <utility>

#include "daemon/modbus/server.h"
#include "tests/daemon/modbus/recording_control.h"
#include "tests/daemon/modbus/snapshots.h"

namespace granary::test {

struct Served {
  explicit Served(ModbusLimits limits = {}, const ModbusTcpOptions& options = {},
                  std::shared_ptr<const TlsContext> tls = nullptr)
      : units(kIdentity, {GoodSnapshot().bin}, control, tally),
        server(ListenTcp("127.0.0.1", 0), options, units, tally, limits, std::move(tls)) {
    units.Publish(GoodSnapshot());
  }
  [[nodiscard]] std::uint16_t Port() const { return server.Port(); }
  [[nodiscard]] ModbusCounters Counters() const { return tally.Read(); }

  RecordingControl control;
  ModbusTally tally;
  ModbusUnits units;
  ModbusServer server;
};

}  // namespace granary::test
