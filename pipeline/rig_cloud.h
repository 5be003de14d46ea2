// Frames of one rig to points in the world, or the reason why not.
#pragma once

#include "pipeline/laps.h"
#include "pipeline/options.h"
#include "pipeline/pipeline.h"
#include "pipeline/quality.h"
#include "pipeline/rig_geometry.h"
#include "pipeline/types/frame.h"
#include "pipeline/types/measurement.h"

namespace granary {

/// On a poor picture the verdict says why, and `view` holds what had been made by then.
struct RigCloud {
  RigView view;
  Verdict verdict;
  PictureQuality quality;
};

/// Checks the frames, rectifies, judges the pictures, matches, and makes points.
/// @param laps, timings the stages' times are added to `timings`
[[nodiscard]] RigCloud MakeCloud(const RigGeometry& geometry, const FramePair& pair, const PipelineOptions& options,
                                 Laps& laps, StageTimings_ms& timings);

}  // namespace granary
