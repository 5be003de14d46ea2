// One scene before two cameras that are triggered apart, each on a thread of its own.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <future>
#include <mutex>

#include "drivers/sim/scene.h"

namespace granary {

/// Says which triggers are one shot: the first of each side within kShotSpan. Both then see the same scene. It stands
/// still within a measurement, as grain does, and has moved one step after each pause. Any thread.
class SimStage {
 public:
  /// More than what lies between the triggers of one pair, less than what lies between two pairs that failed.
  static constexpr std::chrono::milliseconds kShotSpan{500};
  /// More than what lies between the shots of one measurement.
  static constexpr std::chrono::milliseconds kPause{2000};

  /// @throws what SimScene throws
  SimStage(const SimOptions& options, const RigWorld& world);

  /// What `side` sees when it is triggered at `when`. `frame_id` is the shot's number from 1 on, `exposure_start` the
  /// time of its first trigger: a simulated pair has no skew.
  [[nodiscard]] Frame TakePicture(Side side, UtcTime when, const SimExposure& exposure);

  /// The projector's lamp; it works at first.
  void SetLamp(bool works);

 private:
  void BeginShot(UtcTime when);

  std::mutex mutex_;  // guards all that follows
  SimScene scene_;
  std::future<SimScene> next_;  // one step further; none where nothing moves
  bool lamp_works_ = true;
  std::uint64_t shot_ = 0;
  UtcTime begun_{};
  std::array<bool, 2> seen_{};
};

}  // namespace granary
