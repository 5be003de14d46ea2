// What calibrations of simulated boards are off by, in the few numbers that stand for one whose covariance is unknown.
#pragma once

#include "drivers/rig.h"

namespace granary {

/// Prints the root mean squares of the modes over `calibrations` calibrations of the rig (16 views, 0.1 px), and the
/// deviations of volumes by their covariances beside those by the default of pipeline/rig_sensitivity.h.
void PrintCalibrationModes(const RigWorld& world, int calibrations);

}  // namespace granary
