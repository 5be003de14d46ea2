// Options for natural pictures, which have thin things and no speckle.
#pragma once

#include "pipeline/options.h"

namespace granary {

/// A small window, P2 that falls at grey edges, a median before the left-right check; found on Teddy and Cones. No
/// refinement: it is for surfaces wider than its window.
inline StereoOptions ForNaturalPictures() {
  StereoOptions options;
  options.census_width = options.census_height = 5;
  options.p1 = 5;
  options.p2 = 40;
  options.adaptive_p2 = true;
  options.median_px = 5;
  options.uniqueness = 0;
  options.speckle_area_px = 100;
  options.refine_radius_px = 0;
  return options;
}

}  // namespace granary
