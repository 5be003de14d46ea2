// What `granaryctl cameras` lists.
#pragma once

#include <string>
#include <vector>

#include "drivers/options.h"

namespace granary {

struct FoundCamera {
  CameraDriver driver = CameraDriver::kAravis;
  std::string id;                      ///< as the configuration wants it
  std::vector<std::string> other_ids;  ///< by which it is found as well: MAC, IP, /dev/videoN, …
  std::string vendor, model, serial;   ///< empty where not told
  std::string address;                 ///< IP and interface, or the bus
  std::vector<std::string> formats;    ///< pixel formats that this program reads, as `pixel_format` wants them
  std::string note;                    ///< what stands in the way of using it; empty when nothing does
};

/// Asks the network and the USB bus for GenICam cameras; takes about a second. @throws DeviceError
[[nodiscard]] std::vector<FoundCamera> FindAravisCameras();
/// The capture nodes under /dev. Never throws for one that cannot be opened: its note says why.
[[nodiscard]] std::vector<FoundCamera> FindV4l2Cameras();

}  // namespace granary
