// The records of a site on disk: SQLite, one row a cycle, and what clients wrote.
//
// STATE/records.sqlite, WAL mode. Table `schema` has one row, `version` (now 2). Tables of version 1:
//   measurements  id (order of appending), bin, sequence, utc_ns (Unix time), valid (0 or 1), record (the JSON of
//                 daemon/record_json.h)
// Added by version 2:
//   states        bin, state (the JSON of daemon/bin_state.h): what a restart keeps of a bin
//   journal       id, utc_ns, bin, who, what, before, after (JSON text or NULL): every change of a state, and what was
//                 done to a bin by hand; written in one transaction with the state it led to
//   daemon        one row, starts: how often the daemon has been started
// A file of version 1 gains them when it is opened for writing; opened for reading it is read as it is.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <vector>

#include "daemon/bin_state.h"
#include "pipeline/types/measurement.h"

namespace granary {

/// Names the file, the operation and SQLite's own words.
class StoreError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// $STATE_DIRECTORY where systemd set it, else /var/lib/granaryd.
[[nodiscard]] std::filesystem::path StateFolder();

/// Any thread may call any method. Several processes may have it open, one of them writing.
class Store {
 public:
  /// kReadFullDisk: reads a file that was closed in order without writing a byte beside it, which SQLite else does even
  /// for reading; nobody may write it meanwhile. It refuses a file that was not: its newest rows would be missing.
  enum class Access { kRead, kWrite, kReadFullDisk };
  /// Opens FOLDER/records.sqlite; kWrite creates both when absent.
  /// @throws StoreError, also for a schema newer than this program
  explicit Store(const std::filesystem::path& folder, Access access = Access::kWrite);
  ~Store();

  /// Safe on disk when it returns. @throws StoreError (disk full, folder gone)
  void Append(const Measurement& measurement);
  /// Newest valid record of `bin`. @throws StoreError
  [[nodiscard]] std::optional<Measurement> LastGood(int bin) const;
  /// Highest sequence of `bin`; 0 when there is none. @throws StoreError
  [[nodiscard]] std::uint64_t LastSequence(int bin) const;
  /// The newest `count` records, newest last, of one bin or of all. @throws StoreError
  [[nodiscard]] std::vector<Measurement> Last(std::size_t count, std::optional<int> bin = std::nullopt) const;

  /// Replaces the state of `bin` and appends `entries` to the journal, all or nothing; safe on disk when it returns.
  /// @throws StoreError
  void Keep(int bin, const BinState& state, const std::vector<JournalEntry>& entries);
  /// The state kept last; empty when none ever was. @throws StoreError, also for a damaged one
  [[nodiscard]] std::optional<BinState> State(int bin) const;
  /// The newest `count` entries of the journal, newest last, of one bin or of all. @throws StoreError
  [[nodiscard]] std::vector<JournalEntry> Journal(std::size_t count, std::optional<int> bin = std::nullopt) const;
  /// Counts one start of the daemon. @return all starts counted so far, this one too @throws StoreError
  std::uint32_t CountStart();

 private:
  struct Impl;
  mutable std::mutex mutex_;  // guards impl_: one SQLite connection
  std::unique_ptr<Impl> impl_;
};

}  // namespace granary
