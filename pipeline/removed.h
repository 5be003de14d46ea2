// Points that were matched and not taken for grain, and why.
#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "pipeline/colours.h"
#include "pipeline/types/bin.h"

namespace granary {

enum class Removal : std::uint8_t {
  kOutside,   ///< not over the grain floor: outside the footprint, or on excluded floor
  kWall,      ///< in the strip along the edges, where a matching window sees wall and grain
  kAboveBin,  ///< over the grain floor, above the top of the bin
  kObject,    ///< over the grain floor: a beam, a cable, a ladder, a stray point
};

struct RemovedPoints {
  std::vector<Eigen::Vector3f> points_in_world;  ///< metres, picture order
  std::vector<Removal> why;                      ///< one a point
};

/// The finite points that the mask leaves out. Why is told from where they lie, the mask does not say: the strip along
/// the edges is as wide as the one that the kept points stay clear of.
/// @param points_in_world H×W, CV_32FC3, NaN invalid  @param grain_mask H×W, CV_8UC1, 255 where kept
/// @throws std::invalid_argument when their types or sizes do not fit
[[nodiscard]] RemovedPoints FindRemoved(const cv::Mat& points_in_world, const cv::Mat& grain_mask, const Bin& bin);

[[nodiscard]] Rgb ColourOf(Removal why);

}  // namespace granary
