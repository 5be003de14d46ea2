// What a client of a server may ask of the bins: the one way in which anything flows back.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "daemon/options.h"
#include "pipeline/types/bin.h"

namespace granary {

/// The numbers are register 910's.
enum class BinCommand : std::uint16_t {
  kNone = 0,  ///< puts the handshake back to idle
  kMeasure = 1,
  kAcknowledge = 2,  ///< latched alarms go off
  kInhibit = 3,      ///< no projector, no camera until released; survives a restart
  kRelease = 4
};

/// The numbers are register 912's.
enum class CommandResult : std::uint16_t { kIdle = 0, kBusy = 1, kDone = 2, kRejected = 3 };

/// The handshake of one bin: what was asked last, and how far it is.
struct CommandState {
  BinCommand command = BinCommand::kNone;
  CommandResult result = CommandResult::kIdle;
  bool operator==(const CommandState&) const = default;
};

/// Book data as a client writes them: all four or none. Finite numbers.
struct BookData {
  double book_mass_kg = 0;
  double density_kg_m3 = 0;
  double correction = 1;
  double loss_kg = 0;
  bool operator==(const BookData&) const = default;
};

/// What is wrong with them, as Faults(const Inventory&) has it, and for numbers that are not finite; empty when all is
/// well.
[[nodiscard]] std::vector<std::string> Faults(const BookData& book);
/// `inventory` with its book quantity, density, correction and loss replaced.
[[nodiscard]] Inventory WithBook(Inventory inventory, const BookData& book);

/// How one bin's book data stand.
struct BookState {
  Inventory in_force;                           ///< what the next measurement is compared with
  bool writable = false;                        ///< clients may commit (book_source = "registers")
  CommandResult commit = CommandResult::kIdle;  ///< of the newest commit since the start
};

/// Any thread may call any method; each returns at once. `who` names the client for the log and the journal, e.g.
/// "192.168.7.20:40112", "/dev/ttyS1", "plc 192.168.7.20:502", "local". How things went is seen in the bin's snapshot,
/// which is published again before a method that changes it at once returns.
class BinControl {
 public:
  virtual ~BinControl() = default;
  /// Starts a command; its result is busy until it is done or rejected. kNone resets the handshake.
  /// @return false when the command before is still busy, or the bin is not ready: nothing was started
  [[nodiscard]] virtual bool Ask(int bin, BinCommand command, const std::string& who) = 0;
  /// Puts book data in force: checked, journaled and safe on disk before the commit is done; rejected when they cannot
  /// be. The next measurement is compared with them; the published one keeps those it was compared with.
  /// @return false when a commit is still busy, or the bin is not ready, or not writable: nothing was started
  [[nodiscard]] virtual bool CommitBook(int bin, const BookData& book, const std::string& who) = 0;
  /// Takes effect at once and is kept over a restart.
  /// @return false when the bin is not ready
  [[nodiscard]] virtual bool SetFormat(int bin, const RegisterFormat& format, const std::string& who) = 0;
};

}  // namespace granary
