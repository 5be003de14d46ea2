// One measurement from the command line: references, frames, pipeline.
#pragma once

#include "daemon/ctl/setup.h"
#include "pipeline/pipeline.h"

namespace granary {

/// Measures the chosen bin from the files or the cameras; the record has its capture time and the program's peak
/// memory. Says what the pipeline has to note on standard error.
/// @throws what ReferenceFor, TakeShots and Pipeline throw
[[nodiscard]] PipelineRun MeasureBin(const ChosenBin& bin, const FrameFiles& files);

}  // namespace granary
