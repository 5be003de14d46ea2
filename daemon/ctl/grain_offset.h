// How far above the true height the cameras see this grain.
#pragma once

#include "pipeline/types/uncertainty_budget.h"

namespace granary {

struct GrainOffset {
  double offset_m = 0;
  double u95_m = 0;  ///< expanded uncertainty, k = 2
};

/// From one fill of known volume: what was measured too much, spread over the floor that grain covers.
/// Its uncertainty is that of the measurement without its relief, that of the known volume, and a tenth of the offset
/// for other fills and other light.
/// @param measured_m3 volume measured without any offset
/// @param relief_m2 floor area over which the offset counts (PipelineRun::relief_area_m2)
/// @param known_u95_m3 expanded uncertainty of the known volume
/// @throws std::invalid_argument when the area or the known volume is not above 0, or when the offset is larger than
///   the configuration allows and so is no relief; says what to check
[[nodiscard]] GrainOffset FindGrainOffset(double measured_m3, const UncertaintyBudget& budget, double relief_m2,
                                          double known_m3, double known_u95_m3);

}  // namespace granary
