// All shots of one rig to one cloud, or the reason why not.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>

#include "pipeline/laps.h"
#include "pipeline/options.h"
#include "pipeline/rig_cloud.h"
#include "pipeline/rig_geometry.h"
#include "pipeline/types/bin.h"
#include "pipeline/types/frame.h"
#include "pipeline/types/measurement.h"

namespace granary {

struct RigShots {
  RigCloud cloud;  ///< the shots as one; pictures are those of the first, its quality the worst of all
  /// Each shot by itself, CV_32FC1; empty when there is but one. Points are made anew where they are wanted: those of
  /// twenty shots would fill an edge box.
  std::vector<cv::Mat> disparity_px;
};

/// MakeCloud for every shot, then their mean. A picture that is too poor, or something that moved in the bin between
/// two shots, is a verdict.
/// @param rig index of the rig in each shot
[[nodiscard]] RigShots MakeCloudOfShots(const RigGeometry& geometry, const Bin& bin, const std::vector<Shot>& shots,
                                        std::size_t rig, const PipelineOptions& options, Laps& laps,
                                        StageTimings_ms& timings);

}  // namespace granary
