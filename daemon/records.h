// The store as the workers see it: never in the way of measuring.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>

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
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

 private:
  /// Runs `work(store)`; @return false when the store failed
  bool Use(const std::function<void(Store&)>& work);

  std::filesystem::path folder_;
  Clock& clock_;
  std::mutex mutex_;  // guards everything below
  std::unique_ptr<Store> store_;
  FaultLog fault_log_;
  std::map<int, std::uint64_t> last_sequence_;
};

}  // namespace granary
