// The speckle projector's line.
#pragma once

#include <chrono>

namespace granary {

/// Off when built, off when destroyed, off after every pulse, also after one that throws.
class Projector {
 public:
  virtual ~Projector() = default;
  /// Lights the grain for `width` and returns when it is dark again; the rising edge triggers cameras on line0.
  /// @throws DeviceError; std::invalid_argument when `width` exceeds the configured max_on.
  virtual void Pulse(std::chrono::microseconds width) = 0;
};

}  // namespace granary
