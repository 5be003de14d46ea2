// One scene before two cameras that are triggered apart, each on a thread of its own.
#pragma once

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>

#include "drivers/sim/scene.h"

namespace granary {

/// Says which triggers are one shot: the first of each side within kShotSpan. Both then see the same scene, and the
/// next shot finds it one step further. Any thread.
class SimStage {
 public:
  /// More than what lies between the triggers of one pair, less than what lies between two pairs that failed.
  static constexpr std::chrono::milliseconds kShotSpan{500};
  enum class Time { kMovesOn, kStands };

  /// @throws what SimScene throws
  SimStage(const SimOptions& options, const RigWorld& world);

  /// What `side` sees when it is triggered at `when`. `frame_id` is the shot's number from 1 on, `exposure_start` the
  /// time of its first trigger: a simulated pair has no skew.
  /// @param time kStands: a shot that this trigger begins does not move the scene
  [[nodiscard]] Frame TakePicture(Side side, UtcTime when, const SimExposure& exposure, Time time = Time::kMovesOn);

  /// The projector's lamp; it works at first.
  void SetLamp(bool works);

 private:
  void BeginShot(UtcTime when, Time time);
  void PrepareShots(const std::stop_token& stop);

  std::mutex mutex_;  // guards all that follows
  std::condition_variable_any shot_over_;
  SimScene scene_;
  bool moves_;
  bool lamp_works_ = true;
  std::uint64_t shot_ = 0;
  UtcTime begun_{};
  std::array<bool, 2> seen_{};
  bool prepared_ = true;  // the scene is where the next shot is to find it
  std::jthread ahead_;    // last: it uses what stands above
};

}  // namespace granary
