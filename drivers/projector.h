// The speckle projector's line.
#pragma once

#include <chrono>
#include <functional>

#include "pipeline/types/frame.h"

namespace granary {

/// When the projector was surely lit: from after its line rose to before it fell.
struct LitInterval {
  UtcTime from{}, until{};
};

/// Off when built, off when destroyed, off after every pulse, also after one that throws.
class Projector {
 public:
  virtual ~Projector() = default;
  /// Lights the grain for `width` and returns when it is dark again; the rising edge (of the trigger line, `settle`
  /// later, where there is one) triggers cameras on line0.
  /// @param lit called once, as soon as the grain is lit and the light has settled; starts cameras that want a command.
  ///   Its time counts as time of the pulse. What it throws is passed on, after the light is off.
  /// @throws DeviceError; std::invalid_argument when `width` exceeds the configured max_on.
  virtual LitInterval Pulse(std::chrono::microseconds width, const std::function<void()>& lit = {}) = 0;
  /// Fires the trigger line alone, the projector stays dark. @return false where one line drives both
  /// @throws DeviceError
  virtual bool TriggerDark() { return false; }
};

}  // namespace granary
