// Every intermediate of a measurement as files a person can open.
#pragma once

#include <filesystem>

#include "daemon/ctl/setup.h"
#include "pipeline/pipeline.h"

namespace granary {

/// Writes what the run came to: rectified.png left_rectified.png right_rectified.png disparity.png disparity.pfm
/// grain.png cloud.pcd removed.png removed.ply for each rig (with "RIG_" before the name where there are several),
/// height.png mesh.png cloud.ply mesh.ply record.json. The folder is made when absent; files of an earlier run that
/// this one did not come to are removed.
/// @throws FileError
void SaveRun(const std::filesystem::path& folder, const ChosenBin& bin, const PipelineRun& run);

}  // namespace granary
