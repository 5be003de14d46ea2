// The bins as Modbus sees them: one unit each, served alike over TCP, TLS and the serial line.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/control.h"
#include "daemon/modbus/answer.h"
#include "daemon/modbus/registers.h"
#include "daemon/modbus/tally.h"
#include "daemon/publisher.h"
#include "pipeline/types/bin.h"

namespace granary {

/// Who sent a request; borrowed.
struct Requester {
  std::string_view name;   ///< for log and journal: "192.168.7.20:40112", "/dev/ttyS1"
  bool may_write = false;  ///< whether its address, certificate or line may write
};

/// Holds the newest snapshot of every bin and answers requests from it. Any thread may call any method, several servers
/// at a time; none blocks. A reply is made of one snapshot.
class ModbusUnits : public Publisher {
 public:
  /// @param bins at least one; before a bin is published its map says that nothing was measured yet
  /// @param control, tally borrowed
  /// @param utc_now the clock for ages
  /// @throws std::invalid_argument for no bins
  ModbusUnits(ModbusIdentity identity, const std::vector<Bin>& bins, BinControl& control, ModbusTally& tally,
              std::function<UtcTime()> utc_now = {});
  ~ModbusUnits() override;

  [[nodiscard]] std::string_view Name() const override { return "modbus"; }
  /// Replaces what is served for the snapshot's bin; a bin not known yet is added after the others.
  void Publish(const BinSnapshot& snapshot) override;

  /// Whether a bin has this id. Unlike Answer it takes 0 and 255 for what they are on a serial line: no bin's.
  [[nodiscard]] bool Serves(std::uint8_t unit) const;
  /// The reply to one request: unit ids are bin ids, 0 and 255 mean the first bin, any other gets exception 0x0B.
  /// @param request function code and data, 1…253 bytes
  [[nodiscard]] Pdu Answer(std::uint8_t unit, std::span<const std::uint8_t> request, const Requester& requester);

 private:
  [[nodiscard]] std::shared_ptr<const BinSnapshot> Find(std::uint8_t unit) const;

  const ModbusIdentity identity_;
  BinControl& control_;
  ModbusTally& tally_;
  const std::function<UtcTime()> utc_now_;

  mutable std::mutex mutex_;
  std::vector<std::shared_ptr<const BinSnapshot>> snapshots_;  ///< guarded by mutex_; in the order of the bins
};

}  // namespace granary
