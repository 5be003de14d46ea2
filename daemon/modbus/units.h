// The bins as Modbus sees them: one unit each, served alike over TCP, TLS and the serial line.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "daemon/control.h"
#include "daemon/modbus/answer.h"
#include "daemon/modbus/connection.h"
#include "daemon/modbus/once_per_minute.h"
#include "daemon/modbus/registers.h"
#include "daemon/modbus/tally.h"
#include "daemon/modbus/write.h"
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
  /// @param utc_now the clock for ages @param steady_now the clock that forgets staged book data
  /// @throws std::invalid_argument for no bins
  ModbusUnits(ModbusIdentity identity, const std::vector<Bin>& bins, BinControl& control, ModbusTally& tally,
              std::function<UtcTime()> utc_now = {}, std::function<SteadyTime()> steady_now = {});
  ~ModbusUnits() override;

  [[nodiscard]] std::string_view Name() const override { return "modbus"; }
  /// Replaces what is served for the snapshot's bin; a bin not known yet is added after the others.
  void Publish(const BinSnapshot& snapshot) override;

  /// Whether a bin has this id. Unlike Answer it takes 0 and 255 for what they are on a serial line: no bin's.
  [[nodiscard]] bool Serves(std::uint8_t unit) const;
  /// The reply to one request: unit ids are bin ids, 0 and 255 mean the first bin, any other gets exception 0x0B.
  ///
  /// A write is done whole or not at all; its effect is seen in the snapshot that the control publishes next. Staged
  /// book data belong to the requester's host until it commits them, or for a minute after it wrote the last of them.
  /// @param request function code and data, 1…253 bytes
  [[nodiscard]] Pdu Answer(std::uint8_t unit, std::span<const std::uint8_t> request, const Requester& requester);

 private:
  /// A bin with its registers, encoded when they are first asked for after a change or a second.
  struct Unit {
    std::shared_ptr<const BinSnapshot> snapshot;
    std::optional<BookStage> stage;
    std::optional<std::chrono::sys_seconds> encoded;  ///< when the two below were made; empty: out of date
    RegisterImage registers{};
    std::uint64_t coils = 0;
  };
  struct Now {
    UtcTime utc;
    SteadyTime steady;
  };
  /// What is left to do of a write when nothing is locked.
  struct Commit {
    BookData book;
    std::optional<BookStage> before;  ///< comes back when the book data are not taken
  };
  using Task = std::variant<std::monostate, ModbusException, RegisterFormat, BinCommand, Commit>;

  [[nodiscard]] Now Clocks() const { return {utc_now_(), steady_now_()}; }
  // These expect mutex_ to be held.
  [[nodiscard]] Unit* Find(std::uint8_t unit);
  void Refresh(Unit& unit, const Now& now) const;
  [[nodiscard]] UnitView ViewOf(const Unit& unit) const;
  [[nodiscard]] Task Prepare(Unit& unit, std::span<const std::uint8_t> request, const Requester& requester, Now now);
  [[nodiscard]] Task Stage(Unit& unit, const BookWrite& write, const Requester& requester, SteadyTime now);

  [[nodiscard]] Pdu Write(std::uint8_t unit, std::span<const std::uint8_t> request, const Requester& requester);
  /// @return false when the control does not take it now
  [[nodiscard]] bool Do(const Task& task, int bin, const Requester& requester);
  [[nodiscard]] std::optional<int> CountLine(OncePerMinute& log);
  void LogRefusal(std::span<const std::uint8_t> request, const Requester& requester);
  void LogBookFaults(const std::vector<std::string>& faults, const Requester& requester);

  const ModbusIdentity identity_;
  BinControl& control_;
  ModbusTally& tally_;
  const std::function<UtcTime()> utc_now_;
  const std::function<SteadyTime()> steady_now_;

  mutable std::mutex mutex_;              ///< never held while calling the control
  std::vector<Unit> units_;               ///< guarded by mutex_; in the order of the bins
  OncePerMinute refused_log_, book_log_;  ///< guarded by mutex_
};

}  // namespace granary
