// From the ids in a configuration to open cameras. Of camera_aravis*.cpp alone.
#pragma once

#include <string>

#include "drivers/camera_aravis_glib.h"

struct _ArvCamera;

namespace granary {

/// Opens the one camera that `id` names, by serial, "Vendor-Serial", MAC, IP or Aravis' own id, and takes control of
/// it; tries for three seconds, in which the heartbeat of a program that died runs out. Any thread.
/// @throws DeviceError: kCameraUnavailable naming the cameras that are there, kCameraInUse when another program holds
/// it
[[nodiscard]] GOwner<_ArvCamera> OpenArvCamera(const std::string& id);

}  // namespace granary
