// The Modbus RTU server on a serial line.
#pragma once

#include <chrono>
#include <memory>
#include <thread>

#include "daemon/modbus/tally.h"
#include "daemon/modbus/units.h"
#include "daemon/options.h"

namespace granary {

/// How long a port that went away is left before it is tried again: the first time, and at most.
struct RtuReopening {
  std::chrono::milliseconds first{1000}, most{30000};
  bool wait_for_port = false;  ///< one that cannot be opened at the start is waited for, too
};

/// Serves the units from one thread of its own, from construction to destruction. Answers the ids in `units` (all bins
/// when empty), carries out what is written to all (address 0) when `write` is set, and stays silent to everything
/// else. A port that goes away is logged and opened again, for as long as it takes.
class RtuServer {
 public:
  /// @param units, tally borrowed
  /// @throws std::runtime_error that names device and cause when the port cannot be opened and is not waited for
  /// @throws std::invalid_argument when an id in `options.units` is no bin's
  RtuServer(const ModbusRtuOptions& options, ModbusUnits& units, ModbusTally& tally, RtuReopening reopening = {});
  ~RtuServer();
  RtuServer(const RtuServer&) = delete;
  RtuServer& operator=(const RtuServer&) = delete;

 private:
  class Loop;

  std::unique_ptr<Loop> loop_;
  std::jthread thread_;  // last: stopped and joined before anything that it uses goes
};

}  // namespace granary
