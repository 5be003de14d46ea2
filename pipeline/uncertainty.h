// The stated uncertainty of a volume: a budget after the GUM, term by term (docs/method.md, §8).
#pragma once

#include <optional>

#include "pipeline/types/uncertainty_budget.h"

namespace granary {

/// Noise of a cloud that a surface is made from.
struct CloudNoise {
  double height_m = 0;       ///< root mean square of the points' standard deviations, as the refinement states them
  double points = 0;         ///< how many
  double correlated_px = 1;  ///< neighbouring points whose noise goes together: the matching window
  double depth_step_m = 0;   ///< change of depth for one pixel of disparity
};

/// What the budget is made from. Deviations are standard ones, not expanded.
struct BudgetInputs {
  double area_m2 = 0;          ///< grain floor under the surface
  double interpolated_m2 = 0;  ///< of it without a measured point
  double interpolated_m3 = 0;  ///< volume over that part
  CloudNoise surface;
  std::optional<CloudNoise> empty_bin;           ///< empty: the floor was never seen, heights are counted from z = 0
  double camera_height_m = 0;                    ///< left camera above the floor
  double calibration_m3 = 0, pose_m3 = 0;        ///< see rig_sensitivity.h
  std::optional<double> completion_deviation_m;  ///< of the mean made-up height, see completion.h
  double relief_m2 = 0;                          ///< floor area over which the grain's relief counts
  double relief_deviation_m = 0;                 ///< of its offset
  std::optional<double> shots_deviation_m3;      ///< scatter of the shots' own volumes
  int shots = 1;
};

[[nodiscard]] UncertaintyBudget VolumeBudget(const BudgetInputs& inputs);

}  // namespace granary
