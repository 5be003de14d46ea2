// Disparities to whole pixels and a coarse fraction: census, semi-global matching, checks (METHOD §3).
#pragma once

#include <opencv2/core/mat.hpp>

#include "pipeline/options.h"
#include "pipeline/stereo/aggregate.h"
#include "pipeline/stereo/census.h"
#include "pipeline/stereo/usable.h"

namespace granary {

/// A rectified pair, ready to be matched.
struct GreyPair {
  cv::Mat left, right;  ///< CV_32FC1, one size
  UsablePixels usable;
  double levels_of_255 = 1;  ///< grey levels of 255 per unit of the pictures
};

/// Memory for pictures of one size, for the next pair.
struct SearchBuffers {
  CensusImage left_census, right_census;
  AggregateBuffers aggregate;
  Winners winners;
  cv::Mat left_disparity, right_disparity, filtered;
};

/// @param tiles where to search, tile by tile; null searches the whole range everywhere
/// @return H×W, CV_32FC1, px, +inf invalid
[[nodiscard]] cv::Mat SearchDisparity(const GreyPair& pair, DisparityRange range, const StereoOptions& options,
                                      const DisparityTiles* tiles, SearchBuffers& memory);

}  // namespace granary
