// One measuring cycle as a state machine: capture, measure, judge, perhaps again, publish.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string_view>
#include <vector>

#include "daemon/change_gate.h"
#include "daemon/clock.h"
#include "daemon/options.h"
#include "pipeline/types/frame.h"
#include "pipeline/types/measurement.h"

namespace granary {

/// kIdle → kCapturing → kMeasuring → kGating → kPublishing → kIdle, with kGating → kRetrying → kCapturing for a gate
/// that failed and may pass the next time. A requested stop leads from every state to kIdle without publishing, but for
/// a good figure that is already there.
enum class CycleState : std::uint8_t { kIdle, kCapturing, kMeasuring, kGating, kRetrying, kPublishing };

/// A trial is one attempt between two scheduled cycles, to see whether a device that failed is back: it is published
/// when it succeeds and leaves no trace when it does not.
enum class CycleKind : std::uint8_t { kScheduled, kTrial };

/// For status lines, e.g. "measuring".
[[nodiscard]] std::string_view NameOf(CycleState state);

/// True when the same cycle may well succeed a moment later: camera, projector and picture. What was prepared wrongly
/// (calibration, reference) stays wrong.
[[nodiscard]] bool IsWorthRetrying(Reason reason);

/// What a cycle does to the outside.
struct CycleSteps {
  /// One or more shots, each one pair a rig. @throws DeviceError
  std::function<std::vector<Shot>()> capture;
  /// The pipeline's verdict. An exception that is no logic_error becomes kInternal.
  std::function<Measurement(const std::vector<Shot>&)> measure;
  /// Takes the end of the cycle: a valid measurement, or the reason why there is none.
  std::function<void(const Measurement&)> publish;
  /// Told of every state entered.
  std::function<void(CycleState)> entered;
};

/// Used by one thread, the worker's.
class Cycle {
 public:
  /// @param good last good measurement, that changes are judged against
  Cycle(CycleOptions options, CycleSteps steps, Clock& clock, std::optional<Measurement> good);

  /// One whole cycle. @return its measurement as published; empty when `stop` ended it before, or a trial failed
  std::optional<Measurement> Run(const std::stop_token& stop, CycleKind kind = CycleKind::kScheduled);
  /// Leaves kIdle. @throws std::logic_error in any other state
  void Begin(CycleKind kind = CycleKind::kScheduled);
  /// Does the work of the current state and enters the next one; nothing in kIdle.
  void Step(const std::stop_token& stop);

  [[nodiscard]] CycleState state() const { return state_; }
  /// Captures begun in this cycle, from 1.
  [[nodiscard]] int attempt() const { return attempt_; }

 private:
  void Enter(CycleState state);
  void Capture();
  void Measure();
  void Judge(const std::stop_token& stop);
  void Fail(Reason reason, std::string_view detail);

  CycleOptions options_;
  CycleSteps steps_;
  Clock& clock_;
  ChangeGate gate_;
  CycleState state_ = CycleState::kIdle;
  CycleKind kind_ = CycleKind::kScheduled;
  int attempt_ = 0;
  std::vector<Shot> shots_;
  double capture_ms_ = 0;
  UtcTime began_{};
  Measurement outcome_;
  bool published_ = false;
};

}  // namespace granary
