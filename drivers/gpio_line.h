// One output line of a GPIO chip. Built on libgpiod 1.6 (projector_gpio_v1.cpp) or 2.x (projector_gpio_v2.cpp).
#pragma once

#include <filesystem>
#include <memory>
#include <string>

namespace granary {

/// Requested for output and inactive from the moment it is there; made inactive and released at the end.
class OutputLine {
 public:
  virtual ~OutputLine() = default;
  /// Active or not; the level is the other way round on an active-low line. Any thread, one at a time.
  /// @throws DeviceError (kProjectorFault)
  virtual void Set(bool active) = 0;
};

struct LineRequest {
  std::string chip{};  ///< "/dev/gpiochipN", "gpiochipN" or the chip's label
  int offset = 0;      ///< on the chip
  std::string name{};  ///< in place of the offset when not empty
  bool active_low = false;
  std::string consumer = "granaryd";  ///< what gpioinfo shows
};

/// @param devices where the chips' device files are (tests bring their own)
/// @throws DeviceError (kProjectorFault) naming chip and line when the chip is absent (with those that are there), two
///   chips have this label, the chip has no such line or two lines of this name, the line is busy (with the program
///   that holds it), or the device may not be opened (with what has to be allowed)
[[nodiscard]] std::unique_ptr<OutputLine> OpenOutputLine(const LineRequest& request,
                                                         const std::filesystem::path& devices = "/dev");

}  // namespace granary
