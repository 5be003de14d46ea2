// What is known of a rig before its first picture: everything that calibration, pose and bin decide.
#pragma once

#include <string>

#include <opencv2/core/mat.hpp>

#include "pipeline/options.h"
#include "pipeline/pipeline.h"
#include "pipeline/rectify.h"
#include "pipeline/types/bin.h"
#include "pipeline/types/transform.h"

namespace granary {

/// Made once, never changed.
struct RigGeometry {
  RigSetup setup;
  Rectification rectification;
  RangeProposal range;
  RigidTransform rectified_from_world = RigidTransform::Identity();
  cv::Mat left_mask, right_mask;  ///< CV_8UC1, the bin's floor in the rectified pictures
  double floor_in_view = 0;       ///< share of the grain floor inside both pictures
  double floor_step_m = 0;        ///< change of depth for one pixel of disparity at the floor
  double spacing_m = 0;           ///< distance of neighbouring points at the floor
  double camera_height_m = 0;     ///< left camera above z = 0
};

/// @throws std::invalid_argument when calibration, pose or reference cannot be used, naming the rig and why
[[nodiscard]] RigGeometry DescribeRig(RigSetup setup, const Bin& bin, const PipelineOptions& options);

}  // namespace granary
