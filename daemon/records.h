// The store as the workers see it: never in the way of measuring.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "daemon/bin_state.h"
#include "daemon/clock.h"
#include "daemon/fault_log.h"
#include "daemon/store.h"

namespace granary {

/// Appends and restores; trouble with the store is logged on change and hourly, and a store that failed is opened anew
/// at the next use. Any thread.
class Records {
 public:
  Records(std::filesystem::path folder, Clock& clock);
  /// Stores `measurement` with the next sequence number of its bin and gives it that number; without a working store
  /// the numbers go on from the last known one.
  void Append(Measurement& measurement);
  /// Newest valid record of `bin`; empty when there is none or it cannot be read.
  [[nodiscard]] std::optional<Measurement> LastGood(int bin);
  /// What a restart keeps of `bin`; a fresh one when nothing was kept, or there is no store yet.
  /// @return empty when there is a store and it cannot be read: nobody knows what it says
  [[nodiscard]] std::optional<BinState> State(int bin);
  /// Store::Keep. @return false when it is not safe on disk; nothing of it is kept then
  [[nodiscard]] bool Keep(int bin, const BinState& state, const std::vector<JournalEntry>& entries);
  /// Starts of the daemon before this one, which is counted by the first call. Empty when they cannot be counted.
  [[nodiscard]] std::optional<std::uint32_t> Restarts();
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

 private:
  /// Runs `work(store)`; @return false when the store failed
  bool Use(const std::function<void(Store&)>& work);
  /// The same for work that only reads, which a full disk does not stop either.
  bool Read(const std::function<void(const Store&)>& work);
  void NoteKept();

  std::filesystem::path folder_;
  Clock& clock_;
  std::mutex mutex_;  // guards everything below
  std::unique_ptr<Store> store_;
  FaultLog fault_log_;
  std::map<int, std::uint64_t> last_sequence_;
  std::optional<std::uint32_t> restarts_;
};

}  // namespace granary
