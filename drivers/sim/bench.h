// What a simulated rig's cameras and projector share: the scene, and which trigger the last shot had.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "drivers/sim/scene.h"

namespace granary {

/// A shot begins with the first pulse, or with the first grab where none came, after a camera was armed; both cameras
/// then see it. Owned through shared_ptr by two cameras and a projector that are all used by one thread.
class SimBench {
 public:
  SimBench(const SimOptions& options, const RigWorld& world);

  /// Camera `side` waits for a trigger; a shot that was taken before is over.
  void Arm(Side side);
  void Disarm(Side side) noexcept;
  /// The projector lights: takes the shot when a camera waits. From the second pulse on, the scene first moves one
  /// step.
  void Pulse();
  /// The picture that `side` has of the shot, once an arm; nothing when not armed. Without a pulse the shot is taken
  /// now, in ambient light only. `exposure_start` is the shot's time on the system clock, `frame_id` counts the shots.
  [[nodiscard]] std::optional<Frame> Grab(Side side, const SimExposure& exposure);

  [[nodiscard]] const SimScene& scene() const { return scene_; }

 private:
  void TakeShot(bool lit);

  struct Shot {
    UtcTime time;
    bool lit = false;
  };
  SimScene scene_;
  std::array<bool, 2> armed_{};
  std::optional<Shot> shot_;
  std::uint64_t shots_ = 0;
  std::uint64_t pulses_ = 0;
};

}  // namespace granary
