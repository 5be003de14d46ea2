// A server of one measured bin, with all that it borrows.
#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "daemon/modbus/server.h"
#include "tests/daemon/modbus/recording_control.h"
#include "tests/daemon/modbus/snapshots.h"

namespace granary::test {

/// A request for register 5 of bin 3, and what a Served answers.
inline const std::vector<std::uint8_t> kReadSequence{0, 9, 0, 0, 0, 6, 3, 3, 0, 5, 0, 1};
inline const std::vector<std::uint8_t> kSequence{0, 9, 0, 0, 0, 5, 3, 3, 2, 0, 17};

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
