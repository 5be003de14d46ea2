// A cycle is a triangle wave: the way travelled, folded between the two marks.
#include "drivers/sim/motion.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace granary {

double VolumeAt_m3(const SimOptions& options, std::uint64_t step, double empty_m3, double full_m3) {
  const double start_m3 = options.volume_m3;
  const double way_m3 = static_cast<double>(step) * options.volume_step_m3;
  switch (options.motion) {
    case SimMotion::kStill:
      return start_m3;
    case SimMotion::kFilling:
      return std::max(start_m3, std::min(start_m3 + way_m3, full_m3));
    case SimMotion::kDraining:
      return std::min(start_m3, std::max(start_m3 - way_m3, empty_m3));
    case SimMotion::kCycle: {
      const double span_m3 = full_m3 - empty_m3;
      if (step == 0 || !(span_m3 > 0)) return start_m3;
      const double from_empty_m3 = std::clamp(start_m3, empty_m3, full_m3) - empty_m3 + way_m3;
      const double folded_m3 = std::fmod(from_empty_m3, 2 * span_m3);
      return empty_m3 + (folded_m3 <= span_m3 ? folded_m3 : 2 * span_m3 - folded_m3);
    }
  }
  throw std::logic_error("VolumeAt_m3: no such motion");
}

}  // namespace granary
