// The controls of a V4L2 node: exposure, gain, and any other by its name.
#pragma once

#include <chrono>
#include <optional>
#include <vector>

#include "drivers/options.h"
#include "drivers/v4l2_node.h"

namespace granary {

/// Everything automatic off, where the node has it: exposure, gain, white balance, focus, brightness, hue.
/// @throws DeviceError (kSettingRefused) when one cannot be switched off
void SwitchAutomaticsOff(const V4l2Node& node);

/// Sets the exposure and reads it back. V4L2 counts it in steps of 100 us (V4L2_CID_EXPOSURE_ABSOLUTE). A driver that
/// has only V4L2_CID_EXPOSURE tells no unit, so that one is left to `features`.
/// @return false where the node has no control in known units
/// @throws DeviceError (kSettingRefused) with the key, range and step when no step is within 1 % of the wish
bool SetExposureTime(const V4l2Node& node, double exposure_us);
/// The exposure as the node has it now; empty where it has no control in known units, or chooses by itself.
[[nodiscard]] std::optional<std::chrono::nanoseconds> ExposureTime(const V4l2Node& node);

/// 0 sets the gain to its least, where the node has one; V4L2 tells no unit of it, so that any other value is refused
/// and `features` is the way. @throws DeviceError
void SetGain(const V4l2Node& node, double gain_db);

/// Sets controls by name, in order, and reads each back. Names as the driver has them ("Power Line Frequency") or as
/// `v4l2-ctl -l` writes them ("power_line_frequency"); menus take an entry's number or its words.
/// @throws DeviceError (kSettingRefused) naming the control and what it allows
void SetControls(const V4l2Node& node, const std::vector<Feature>& features);

}  // namespace granary
