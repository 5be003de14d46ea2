// Planes through the disparities of a window, for whole rows at once.
#pragma once

#include <cstdint>

namespace granary {

/// Sums down the columns of a window, one float a pixel of the row: over the valid disparities, with their height k
/// above or below the middle row.
struct DisparityColumns {
  float *n, *k, *kk;   ///< count, Σ k, Σ k²
  float *d, *kd, *dd;  ///< Σ d, Σ k d, Σ d², d counted from a reference
};

/// Moves the columns one row down. @param enters, leaves rows of disparities, +inf invalid
void SlideDisparityColumns(const float* enters, const float* leaves, int radius, float reference_px, int width,
                           const DisparityColumns& columns);

/// Least-squares planes, one a pixel of the row: value at the pixel, slopes, mean squared departure of the disparities.
struct PlaneRow {
  float *value_px, *slope_x, *slope_y;
  float* variance_px2;  ///< +inf where the window has too few disparities, or all to one side
};
void FitPlanes(const DisparityColumns& columns, int radius, float reference_px, int width, const PlaneRow& planes);

/// Where a pixel's own window is smooth: its plane's value in `start_px`. Elsewhere NaN, and the columns of those that
/// are valid in `contested`, which has room for a vector more than the row. @return how many those are
int TakeOwnPlanes(const float* disparity_px, const PlaneRow& planes, float smooth_variance_px2, float reach_px,
                  int width, float* start_px, std::int32_t* contested);

}  // namespace granary
