// The stated uncertainty of a volume: a first budget after the GUM, term by term (docs/method.md).
#pragma once

#include "pipeline/types/uncertainty_budget.h"

namespace granary {

/// What the budget is made from. Standard deviations, not expanded.
struct UncertaintyInputs {
  double grain_floor_m2 = 0;
  double volume_m3 = 0;
  double interpolated_m3 = 0;
  double surface_step_m = 0;    ///< change of depth for one pixel of disparity at the grain's surface
  double floor_step_m = 0;      ///< the same at the floor
  double camera_height_m = 0;   ///< left camera above the floor
  bool floor_measured = false;  ///< heights are counted from the empty bin seen by the same rig
};

[[nodiscard]] UncertaintyBudget VolumeUncertainty(const UncertaintyInputs& inputs);

}  // namespace granary
