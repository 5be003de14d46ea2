// The volume is linear in the offset (pipeline/relief.h), so one fill finds it.
#include "daemon/ctl/grain_offset.h"

#include <cmath>
#include <cstdio>
#include <stdexcept>

namespace granary {

namespace {

constexpr double kLargest_m = 0.02;  // as the configuration allows
constexpr double kOtherFills = 0.1;  // of the offset: packing and light differ from fill to fill

}  // namespace

GrainOffset FindGrainOffset(double measured_m3, const UncertaintyBudget& budget, double relief_m2, double known_m3,
                            double known_u95_m3) {
  if (!(known_m3 > 0)) throw std::invalid_argument("the known volume must be more than 0 m³");
  if (!(relief_m2 > 0)) throw std::invalid_argument("no grain covers the floor; fill the bin first");
  GrainOffset found;
  found.offset_m = (measured_m3 - known_m3) / relief_m2;
  if (std::abs(found.offset_m) > kLargest_m) {
    char words[200];
    std::snprintf(
        words, sizeof words,
        "%.5g m³ were measured where %.5g m³ are known: %.1f mm over the floor is no relief of grain (at most "
        "%.0f mm); check the known volume, footprint_m, the pose and the reference",
        measured_m3, known_m3, 1000 * found.offset_m, 1000 * kLargest_m);
    throw std::invalid_argument(words);
  }
  UncertaintyBudget rest = budget;
  rest.relief_m3 = 0;
  const double from_volumes_m = std::hypot(rest.Expanded_m3(), known_u95_m3) / relief_m2;
  found.u95_m = std::hypot(from_volumes_m, 2 * kOtherFills * found.offset_m);
  return found;
}

}  // namespace granary
