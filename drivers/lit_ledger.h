// How long a light was lit lately, and when it may be lit again.
#pragma once

#include <chrono>
#include <deque>
#include <memory>
#include <string>

namespace granary {

/// Keeps the lit time in any ten seconds below a limit. Not thread-safe.
class LitLedger {
 public:
  using Time = std::chrono::steady_clock::time_point;
  using Duration = std::chrono::steady_clock::duration;
  static constexpr std::chrono::seconds kWindow{10};

  /// The light was lit from `from` until `until`; later than all that was added before.
  void Add(Time from, Time until);
  /// How long it was lit between these two.
  [[nodiscard]] Duration LitBetween(Time from, Time until) const;
  /// When a pulse of `width` may begin so that no window holds more than `limit`: `now`, or later.
  /// @param width at most `limit`
  [[nodiscard]] Time AllowedFrom(Time now, Duration width, Duration limit) const;

 private:
  struct Span {
    Time from, until;
  };
  std::deque<Span> spans_;  ///< of the last window, oldest first
};

/// The ledger of one line, the same for as long as the process lives: a projector that is torn down and opened anew
/// after a fault has not cooled for that. Any thread; what it returns is for one user at a time.
[[nodiscard]] std::shared_ptr<LitLedger> LedgerOfLine(const std::string& line);

}  // namespace granary
