// Capture nodes in a folder of devices.
#pragma once

#include <filesystem>
#include <vector>

#include "drivers/found_camera.h"
#include "drivers/v4l2_system.h"

namespace granary {

/// What FindV4l2Cameras lists, of the nodes in `dev` (/dev).
[[nodiscard]] std::vector<FoundCamera> FindV4l2Cameras(V4l2System& system, const std::filesystem::path& dev);

}  // namespace granary
