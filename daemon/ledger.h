// The clerk of one bin: writes down what clients change, on a thread that keeps nobody waiting.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "daemon/bin_state.h"
#include "daemon/records.h"

namespace granary {

/// One change of a bin's state, as it goes to disk.
struct LedgerEntry {
  std::vector<JournalEntry> journal;      ///< what is said of it; may be empty
  std::function<void(BinState&)> change;  ///< called on the ledger's thread; may be empty
  bool only_if_stored = false;            ///< undone when the disk refuses; else tried again
  std::function<void(bool stored)> done;  ///< called on the ledger's thread; may be empty
};

/// Entries are written in the order in which they come, each with its journal in one transaction. What the disk refused
/// goes along with the next entry, and is tried again every ten seconds. Any thread may call any method.
class Ledger {
 public:
  /// @param records borrowed
  /// @param state as it is on disk now
  Ledger(Records& records, int bin, BinState state);
  /// Writes what waits, then ends.
  ~Ledger();
  Ledger(const Ledger&) = delete;
  Ledger& operator=(const Ledger&) = delete;

  /// Returns at once.
  void Post(LedgerEntry entry);
  /// True while so much waits for the disk that clients' changes are to be refused: a flood must fill no memory.
  [[nodiscard]] bool Full();
  /// Blocks until all that was posted before has been tried. Not from the ledger's own thread.
  void Drain();

 private:
  void Run(const std::stop_token& stop);
  void Write(LedgerEntry& entry);

  Records& records_;
  const int bin_;
  // The thread's own: the state as it is to be on disk, and what the disk refused of it and of the journal.
  BinState state_;
  bool unsaved_ = false;
  std::vector<JournalEntry> unwritten_;

  std::mutex mutex_;  // guards what follows
  std::condition_variable_any changed_;
  std::deque<LedgerEntry> waiting_;
  bool writing_ = false;
  std::jthread thread_;
};

}  // namespace granary
