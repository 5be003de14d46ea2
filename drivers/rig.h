// One stereo pair under one projector: capture of one synchronised pair of frames.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <utility>

#include "drivers/camera.h"
#include "drivers/options.h"
#include "drivers/projector.h"
#include "pipeline/types/bin.h"
#include "pipeline/types/calibration.h"
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
  using Clock = std::function<UtcTime()>;

  /// @param projector   null: no pulse is given
  /// @param max_skew    largest difference of the two exposure starts
  /// @param pulse_width how long the projector is lit, at least the exposure
  /// @param now         the time given to frames whose camera does not tell it
  Rig(
      std::unique_ptr<Camera> left, std::unique_ptr<Camera> right, std::unique_ptr<Projector> projector,
      std::chrono::microseconds max_skew, std::chrono::microseconds pulse_width,
      Clock now = [] { return UtcTime(std::chrono::system_clock::now()); });

  /// Arms both cameras, pulses the projector once, grabs both frames, checks that they belong together, and disarms
  /// on every path. A pair that is incomplete or mismatched is never returned. They belong together when their
  /// exposures started within max_skew (where both cameras tell) and their counters advanced alike since the last
  /// capture (where both count upwards).
  /// @throws DeviceError (kFrameMissing, kSkewTooLarge, and what cameras and projector throw);
  ///   std::invalid_argument when pulse_width is more than the projector allows
  [[nodiscard]] FramePair CapturePair();
  /// Ends a CapturePair that blocks in another thread. Any thread.
  void Interrupt() noexcept;

 private:
  std::unique_ptr<Camera> left_, right_;
  std::unique_ptr<Projector> projector_;
  std::chrono::microseconds max_skew_, pulse_width_;
  Clock now_;
  std::optional<std::pair<std::uint64_t, std::uint64_t>> last_ids_;  ///< of the last capture that grabbed both
};

/// Opens the cameras and the projector that `options` names.
/// Simulated cameras come in pairs and share one scene with a simulated projector; with projector "none" they see
/// ambient light only. A replay camera goes with any real one.
/// @throws DeviceError when a device is absent; std::invalid_argument for a driver this build does not have, for
///   simulated and real devices mixed, and for what SimScene refuses.
[[nodiscard]] Rig OpenRig(const RigOptions& options, const RigWorld& world);

}  // namespace granary
