// The Modbus TCP server.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string_view>
#include <thread>
#include <vector>

#include "daemon/modbus/connection.h"
#include "daemon/modbus/registers.h"
#include "daemon/modbus/socket.h"
#include "daemon/options.h"
#include "daemon/publisher.h"
#include "pipeline/types/bin.h"

namespace granary {

/// Serves the register map of every bin from one thread of its own, from construction to destruction. The unit id is
/// the bin's id; 0 and 255 mean the first bin; any other id is answered with exception 0x0B. Before a bin is published
/// for the first time its map says that nothing was measured yet.
///
/// Every member may be called from any thread; none blocks on a client.
class ModbusServer : public Publisher {
 public:
  /// @param listener a listening TCP socket: from ListenTcp, or inherited (systemd)
  /// @param options `allow` and `max_clients` are used; host and port are the listener's
  /// @param bins at least one
  /// @param utc_now the clock for ages
  /// @throws std::invalid_argument for a network that is no CIDR or for no bins; std::runtime_error when `listener`
  /// does not listen
  ModbusServer(FileDescriptor listener, const ModbusTcpOptions& options, ModbusIdentity identity,
               const std::vector<Bin>& bins, ModbusLimits limits = {}, std::function<UtcTime()> utc_now = {});
  ~ModbusServer() override;
  ModbusServer(const ModbusServer&) = delete;
  ModbusServer& operator=(const ModbusServer&) = delete;

  [[nodiscard]] std::string_view Name() const override { return "modbus"; }
  /// Replaces what is served for the snapshot's bin; a bin not known yet is added after the others.
  void Publish(const BinSnapshot& snapshot) override;

  [[nodiscard]] std::uint16_t Port() const { return port_; }
  [[nodiscard]] ModbusCounters Counters() const;

 private:
  class Loop;

  [[nodiscard]] std::shared_ptr<const BinSnapshot> Find(std::uint8_t unit) const;
  [[nodiscard]] std::vector<std::uint8_t> Reply(const ModbusFrame& frame) const;

  const ModbusIdentity identity_;
  const std::function<UtcTime()> utc_now_;
  const std::uint16_t port_;
  std::atomic<std::uint32_t> clients_ = 0, requests_ = 0, malformed_ = 0, refused_ = 0, evicted_ = 0, timed_out_ = 0;

  mutable std::mutex mutex_;
  std::vector<std::shared_ptr<const BinSnapshot>> snapshots_;  ///< guarded by mutex_; in the order of the bins

  std::unique_ptr<Loop> loop_;
  std::jthread thread_;  // last: stopped and joined before anything that it uses goes
};

}  // namespace granary
