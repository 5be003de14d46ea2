// Is this volume possible after the last one?
#pragma once

#include <optional>
#include <vector>

#include "pipeline/types/measurement.h"

namespace granary {

/// True when the change from `before` to `now` is within `max_rate_m3_h` times the time between them, plus the
/// uncertainty of both volumes (root of the sum of squares). Both must have a volume.
[[nodiscard]] bool IsPlausibleChange(const Measurement& before, const Measurement& now, double max_rate_m3_h);

/// True when two volumes differ by no more than the uncertainty of both. An unknown uncertainty counts as 1 % of the
/// volume. Both must have a volume.
[[nodiscard]] bool Agree(const Measurement& a, const Measurement& b);

/// Judges volumes against the last good one. A change that persists cannot lock the daemon out for ever: the third of
/// three implausible cycles in a row whose volumes all agree is accepted. Cycles without a volume are not counted.
class ChangeGate {
 public:
  /// @param max_rate_m3_h empty: everything passes  @param good empty: the first volume passes
  ChangeGate(std::optional<double> max_rate_m3_h, std::optional<Measurement> good);
  [[nodiscard]] bool Admits(const Measurement& measurement) const;
  /// Tells the gate how a cycle ended: a valid measurement, or one with kImplausibleChange.
  void Remember(const Measurement& measurement);
  /// The last good one; empty when there is none.
  [[nodiscard]] const std::optional<Measurement>& good() const { return good_; }

 private:
  std::optional<double> max_rate_m3_h_;
  std::optional<Measurement> good_;
  std::vector<Measurement> doubtful_;  // of the cycles just before, all agreeing
};

}  // namespace granary
