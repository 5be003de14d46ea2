// A few hundred patches that stand for the whole surface where a slow rule looks at it.
#pragma once

#include <vector>

#include "pipeline/floor.h"
#include "pipeline/rig_sensitivity.h"
#include "pipeline/surface.h"
#include "pipeline/types/bin.h"

namespace granary {

/// Patches on an even grid over the grain floor, with the smooth surface's height and slope there and those of the
/// floor; their areas sum up to the grain floor's. Empty for an empty surface.
[[nodiscard]] std::vector<SurfaceSample> SampleSurface(const Surface& surface, const Floor& floor, const Bin& bin);

}  // namespace granary
