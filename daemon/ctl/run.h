// One measurement from the command line: references, frames, pipeline.
#pragma once

#include <string>

#include "daemon/ctl/setup.h"
#include "pipeline/pipeline.h"

namespace granary {

/// The options --frames, --ambient and --rig of a command that measures.
/// @param how_often what several pairs of files are to it, e.g. "once a repeat"
void AddFrameOptions(CLI::App& command, FrameFiles& files, std::string& rig, const std::string& how_often);

/// The pipeline of the chosen bin with the references of its rigs; what it has to note is said on standard error.
/// @throws what ReferenceFor and Pipeline throw
[[nodiscard]] Pipeline PipelineOf(const ChosenBin& bin, bool from_files);

/// Measures the chosen bin from the files or the cameras; the record has its capture time and the program's peak
/// memory.
/// @throws what PipelineOf and TakeShots throw
[[nodiscard]] PipelineRun MeasureBin(const ChosenBin& bin, const FrameFiles& files);

}  // namespace granary
