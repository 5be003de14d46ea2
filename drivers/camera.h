// A camera that takes one triggered frame at a time.
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "pipeline/types/frame.h"

namespace granary {

/// Every method but Interrupt is called from one thread, the rig's worker. After a DeviceError, Disarm and the
/// destructor alone are called.
class Camera {
 public:
  virtual ~Camera() = default;
  /// The id the configuration names; never blocks, never throws.
  [[nodiscard]] virtual std::string Id() const = 0;
  /// The exposure time from the next Arm on. @return false where it cannot be set: pictures from files
  /// @throws DeviceError
  virtual bool SetExposure([[maybe_unused]] double exposure_us) { return false; }
  /// Makes the camera wait for the next trigger; frames from before are dropped. May block for a control round trip.
  /// @throws DeviceError
  virtual void Arm() = 0;
  /// Starts an exposure by command; nothing on a camera that a line triggers or that runs free. @throws DeviceError
  virtual void Trigger() {}
  /// The next frame since Arm, oldest first, with pixels of its own: of a triggered camera the frame of the trigger,
  /// of one that runs free any frame whose exposure began after Arm. Blocks up to `timeout`.
  /// @throws DeviceError (kFrameMissing when none came in time)
  [[nodiscard]] virtual Frame Grab(std::chrono::milliseconds timeout) = 0;
  /// Ends waiting for triggers. Never throws; allowed at any time, also when not armed.
  virtual void Disarm() noexcept = 0;
  /// Makes a Grab that blocks in another thread end with DeviceError. Any thread; never blocks.
  virtual void Interrupt() noexcept = 0;
};

}  // namespace granary
