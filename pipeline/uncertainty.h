// The stated uncertainty of a volume: a first budget after the GUM, term by term (docs/method.md).
#pragma once

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

/// Standard uncertainties of the volume, m³.
struct UncertaintyBudget {
  double matching = 0;    ///< bias of the disparity, the same over the whole surface
  double floor = 0;       ///< the same for the empty bin, or the pose's error where it was never seen
  double scale = 0;       ///< baseline and focal length
  double completion = 0;  ///< heights made up where nothing was seen
  double relief = 0;      ///< tops of kernels are seen more than the gaps between them
  /// Expanded, k = 2: the true volume lies within ± this in about 95 % of measurements.
  [[nodiscard]] double Expanded_m3() const;
};

[[nodiscard]] UncertaintyBudget VolumeUncertainty(const UncertaintyInputs& inputs);

}  // namespace granary
