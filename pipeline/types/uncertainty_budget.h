// Where the uncertainty of a volume comes from, term by term.
#pragma once

#include <cmath>
#include <initializer_list>

namespace granary {

/// Standard uncertainties (k = 1) of one volume, m³. The terms are independent of each other (docs/method.md, §8).
struct UncertaintyBudget {
  double matching_m3 = 0;     ///< noise and bias of the grain's disparities
  double reference_m3 = 0;    ///< the same of the empty bin, or the unseen floor's height
  double calibration_m3 = 0;  ///< cameras and their baseline
  double pose_m3 = 0;         ///< where the rig stands in the bin
  double completion_m3 = 0;   ///< heights made up where nothing was seen
  double relief_m3 = 0;       ///< what a matcher makes of the gaps between kernels
  double repeat_m3 = 0;       ///< scatter of the shots' own volumes; 0 with one shot

  [[nodiscard]] double Combined_m3() const {
    double squares = 0;
    for (const double term :
         {matching_m3, reference_m3, calibration_m3, pose_m3, completion_m3, relief_m3, repeat_m3}) {
      squares += term * term;
    }
    return std::sqrt(squares);
  }
  /// Expanded, k = 2: the true volume lies within ± this in about 95 % of measurements.
  [[nodiscard]] double Expanded_m3() const { return 2 * Combined_m3(); }
};

}  // namespace granary
