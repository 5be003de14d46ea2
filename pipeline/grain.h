// Which pixels of a rig show grain: the empty bin taken out, borders and outliers cut (METHOD §5).
#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "pipeline/floor.h"
#include "pipeline/types/bin.h"

namespace granary {

struct GrainOptions {
  double segment_distance_m = 0.004;  ///< nearer than this to the empty bin is scene
  double edge_margin_m = 0.004;       ///< strip along walls and pillars in which a window sees both
  int step_margin_px = 5;             ///< around disparity steps, where a window sees two surfaces
};

struct GrainPoints {
  cv::Mat mask;                                  ///< CV_8UC1, 255 where the point is kept
  std::vector<Eigen::Vector3d> points_in_world;  ///< the kept ones, picture order
  double above_share = 0;                        ///< of the points over the grain floor, those above the bin's top
  double spacing_m = 0;                          ///< median distance of neighbouring kept points on the floor plane
};

/// Keeps the points of grain, and of the floor where it lies bare: a bare floor is a height of 0 that was measured,
/// and leaving it in keeps the thin toe of a heap, which no threshold can tell from it.
///
/// @param points_in_world H×W, CV_32FC3, NaN invalid
/// @param disparity_px H×W, CV_32FC1, +inf invalid
/// @param empty_bin the reference's points, H×W, CV_32FC3; empty Mat when there is none
[[nodiscard]] GrainPoints FindGrain(const cv::Mat& points_in_world, const cv::Mat& disparity_px,
                                    const cv::Mat& empty_bin, const Floor& floor, const Bin& bin,
                                    const GrainOptions& options);

}  // namespace granary
