// How drivers say that a device failed.
#pragma once

#include <stdexcept>
#include <string>

#include "pipeline/types/reason.h"

namespace granary {

/// Device trouble: names the device, the operation and the library's own words. Caught once, in the worker, where
/// `reason()` becomes the cycle's reason code and the device is reopened.
class DeviceError : public std::runtime_error {
 public:
  DeviceError(Reason reason, const std::string& device, const std::string& operation, const std::string& words)
      : std::runtime_error(device + ": " + operation + ": " + words), reason_(reason) {}
  [[nodiscard]] Reason reason() const { return reason_; }

 private:
  Reason reason_;
};

/// True for what may be over a moment later without anybody doing anything about it: a frame lost, late or spoilt.
[[nodiscard]] inline bool IsFleeting(Reason reason) {
  return reason == Reason::kFrameMissing || reason == Reason::kFrameInvalid || reason == Reason::kSkewTooLarge ||
         reason == Reason::kStrayTrigger;
}

}  // namespace granary
