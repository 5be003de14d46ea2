// Time in the scene goes by pulses, so that a run is the same whatever the wall clock does.
#include "drivers/sim/bench.h"

#include <chrono>
#include <cmath>
#include <cstdint>

#include <spdlog/spdlog.h>

namespace granary {

SimBench::SimBench(const SimOptions& options, const RigWorld& world) : scene_(options, world) {}

void SimBench::Arm(Side side) {
  armed_[static_cast<std::size_t>(side)] = true;
  shot_.reset();
}

void SimBench::Disarm(Side side) noexcept { armed_[static_cast<std::size_t>(side)] = false; }

void SimBench::TakeShot(bool lit) {
  shot_ = Shot{std::chrono::system_clock::now(), lit};
  ++shots_;
  spdlog::debug("sim: shot {} {}, the bin holds {:.9g} m3", shots_, lit ? "lit" : "ambient", scene_.TruthVolume_m3());
}

void SimBench::Pulse() {
  if (pulses_++ > 0) scene_.Advance();
  if (!armed_[0] && !armed_[1]) return;
  TakeShot(true);
}

std::optional<Frame> SimBench::Grab(Side side, const SimExposure& exposure) {
  bool& armed = armed_[static_cast<std::size_t>(side)];
  if (!armed) return std::nullopt;
  armed = false;
  if (!shot_) TakeShot(false);
  Frame frame = scene_.RenderSide(side, shots_, shot_->lit, exposure);
  frame.exposure_start = shot_->time;
  frame.exposure_end =
      shot_->time + std::chrono::nanoseconds(static_cast<std::int64_t>(std::llround(exposure.exposure_us * 1000)));
  return frame;
}

}  // namespace granary
