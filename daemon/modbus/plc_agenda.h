// When the PLC is to hear of which bin. Pure: every method is told the time.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "daemon/snapshot.h"
#include "pipeline/types/frame.h"

namespace granary {

/// How often a PLC is tried and told; tests shorten them.
struct PlcLimits {
  std::chrono::milliseconds first_retry{500};      ///< after the first failure; each further one doubles it
  std::chrono::milliseconds longest_retry{60000};  ///< up to here; what is configured wrong waits so long at once
  std::chrono::milliseconds status_gap{1000};      ///< between two pushes for status bits alone
};

/// Waiting times that double up to the longest, each ± 25 % at random, so that a depot's boxes do not all come back at
/// the same moment. Not thread-safe.
class Backoff {
 public:
  /// @param seed the same one gives the same times
  Backoff(const PlcLimits& limits, std::uint32_t seed) : limits_(limits), random_(seed) {}
  /// The wait after one more failure.
  [[nodiscard]] std::chrono::milliseconds Next();
  /// The longest wait at once.
  [[nodiscard]] std::chrono::milliseconds Longest();
  /// To be called after a success.
  void Reset() { failures_ = 0; }

 private:
  [[nodiscard]] std::chrono::milliseconds WithJitter(std::chrono::milliseconds wait);

  PlcLimits limits_;
  std::minstd_rand random_;
  int failures_ = 0;
};

/// What of a snapshot is news to a PLC.
struct PlcNews {
  std::uint64_t good_sequence = 0, last_sequence = 0;
  UtcTime good_utc{}, last_utc{};
  bool injected = false;

  std::uint16_t status = 0;
  std::uint32_t alarms_active = 0, alarms_latched = 0;
  InvalidPolicy invalid = InvalidPolicy::kHold;

  /// Another measurement, real, failed or injected: pushed at once.
  [[nodiscard]] bool SameMeasurement(const PlcNews& other) const;
  /// The rest: pushed soon.
  [[nodiscard]] bool SameState(const PlcNews& other) const;
};
[[nodiscard]] PlcNews PlcNewsOf(const BinSnapshot& snapshot);

/// One snapshot a bin, in the order of the bins; null before the first.
using NewestSnapshots = std::vector<std::shared_ptr<const BinSnapshot>>;

/// Which blocks are due. A bin without a snapshot never is: nobody knows yet what to say of it. Not thread-safe.
class PlcAgenda {
 public:
  using Time = std::chrono::steady_clock::time_point;

  PlcAgenda(std::size_t bins, std::chrono::milliseconds heartbeat, const PlcLimits& limits, std::uint32_t seed);

  /// Bins that are due at `now`, the newest measurement first.
  [[nodiscard]] std::vector<std::size_t> Due(const NewestSnapshots& newest, Time now) const;
  /// When the next one is due; Time::max() when none will be.
  [[nodiscard]] Time NextAt(const NewestSnapshots& newest) const;

  /// The PLC has taken `pushed`.
  void Taken(std::size_t bin, const BinSnapshot& pushed, Time now);
  /// The PLC has answered that it does not take the block. @param lasting until somebody changes a configuration
  void Refused(std::size_t bin, bool lasting, Time now);
  /// Whatever the PLC held may be gone: all bins are due.
  void ConnectedAnew();

 private:
  struct Entry {
    std::optional<PlcNews> taken;
    Time taken_at{};
    Time not_before = Time::min();
    Backoff backoff;
  };
  [[nodiscard]] Time DueAt(const Entry& entry, const BinSnapshot* newest) const;

  const std::chrono::milliseconds heartbeat_, status_gap_;
  std::vector<Entry> entries_;
};

}  // namespace granary
