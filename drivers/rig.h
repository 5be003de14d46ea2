// One stereo pair under one projector: capture of one synchronised pair of frames.
#pragma once

#include <cstdint>
#include <memory>

#include "drivers/camera.h"
#include "drivers/options.h"
#include "drivers/projector.h"
#include "pipeline/types/calibration.h"
#include "pipeline/types/bin.h"
#include "pipeline/types/frame.h"
#include "pipeline/types/transform.h"

namespace granary {

/// What a simulated rig has to know of the world it stands in; real rigs need none of it.
struct RigWorld {
  Bin bin;
  StereoCalibration calibration;
  RigidTransform world_from_left = RigidTransform::Identity();
  bool empty_bin = false;  ///< the simulator shows the bin without grain (for taking the reference)
};

/// Owned and used by one thread, but for Interrupt.
class Rig {
 public:
  Rig(std::unique_ptr<Camera> left, std::unique_ptr<Camera> right, std::unique_ptr<Projector> projector,
      std::chrono::microseconds max_skew, std::chrono::microseconds pulse_width);

  /// Arms both cameras, pulses the projector once, grabs both frames, checks that they belong together, and disarms
  /// on every path. A pair that is incomplete or mismatched is never returned.
  /// @throws DeviceError
  [[nodiscard]] FramePair CapturePair();
  /// Ends a CapturePair that blocks in another thread. Any thread.
  void Interrupt() noexcept;

 private:
  std::unique_ptr<Camera> left_, right_;
  std::unique_ptr<Projector> projector_;
  std::chrono::microseconds max_skew_, pulse_width_;
};

/// Opens the cameras and the projector that `options` names.
/// @throws DeviceError when a device is absent; std::invalid_argument for a driver this build does not have.
[[nodiscard]] Rig OpenRig(const RigOptions& options, const RigWorld& world);

}  // namespace granary
