// Pushes the bins' figures to the depot's PLC.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <string_view>
#include <thread>
#include <vector>

#include "daemon/control.h"
#include "daemon/modbus/plc_agenda.h"
#include "daemon/modbus/plc_block.h"
#include "daemon/modbus/registers.h"
#include "daemon/modbus/tally.h"
#include "daemon/options.h"
#include "daemon/publisher.h"
#include "pipeline/types/bin.h"

namespace granary {

/// Writes the block of each bin for every new measurement, soon after its status or alarm bits change, and as a
/// heartbeat; reads book data where that is configured. Works from one thread of its own, from construction to
/// destruction; it connects with the first snapshot. Whatever the PLC does, or does not, is seen in the tally and the
/// log only. Every member may be called from any thread.
class PlcClient : public Publisher {
 public:
  /// @param bins in the order of their blocks
  /// @param control, tally borrowed; book data are committed through the former
  /// @param utc_now the clock for ages
  /// @param seed of the jitter between attempts to connect
  /// @throws std::invalid_argument with all that PlcFaults finds, for an address that is none, and for no bins
  PlcClient(const ModbusPlcOptions& options, const std::vector<Bin>& bins, ModbusIdentity identity, BinControl& control,
            ModbusTally& tally, std::function<UtcTime()> utc_now = {}, PlcLimits limits = {},
            std::uint32_t seed = std::random_device{}());
  /// Ends at once, but for a host name that is being looked up: that takes up to the timeout.
  ~PlcClient() override;
  PlcClient(const PlcClient&) = delete;
  PlcClient& operator=(const PlcClient&) = delete;

  [[nodiscard]] std::string_view Name() const override { return "plc"; }
  /// Only takes the value; it is pushed when it is still the newest by then. A bin that has no block is not pushed.
  void Publish(const BinSnapshot& snapshot) override;

 private:
  class Loop;

  std::unique_ptr<Loop> loop_;
  std::jthread thread_;  // last: stopped and joined before anything that it uses goes
};

}  // namespace granary
