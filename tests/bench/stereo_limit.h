// The floor under any semi-global matcher of this kind on this machine: path-cost updates and their sums, from cache.
#pragma once

#include <string>
#include <vector>

namespace granary {

/// One way to write the update, as fast as it ran.
struct LimitRate {
  std::string form;          ///< instruction set and how the neighbours d ± 1 are fetched
  double updates_per_s = 0;  ///< all threads together
};

/// Updates a second of `L_r(d) = C(d) + min(L(d), L(d ± 1) + P1, m + P2) − m` with its minimum, costs of 8 bits, eight
/// independent paths a pixel in two groups of four, each group added to sums of 16 bits; nothing is computed besides
/// and everything lies in the first or second cache.
///
/// Every instruction set this processor has is tried, with unaligned loads and with shifts in registers; the fastest
/// comes first.
/// @param disparities a multiple of 64
/// @param threads that run at the same time, each on its own data
[[nodiscard]] std::vector<LimitRate> MeasureLimit(int disparities, int threads);

}  // namespace granary
