// A moved scene costs half a second to light, longer than a client may wait for its frame: the next shot's is lit as
// soon as both sides have seen this one.
#include "drivers/sim/stage.h"

#include <spdlog/spdlog.h>

namespace granary {

SimStage::SimStage(const SimOptions& options, const RigWorld& world)
    : scene_(options, world), moves_(!world.empty_bin && options.motion != SimMotion::kStill) {
  (void)scene_.Render(0);
  ahead_ = std::jthread([this](const std::stop_token& stop) { PrepareShots(stop); });
}

Frame SimStage::TakePicture(Side side, UtcTime when, const SimExposure& exposure, Time time) {
  const std::scoped_lock lock(mutex_);
  bool& seen = seen_.at(static_cast<std::size_t>(side));
  if (shot_ == 0 || seen || when - begun_ > kShotSpan) BeginShot(when, time);
  seen = true;
  Frame frame = scene_.RenderSide(side, shot_, lamp_works_, exposure);
  frame.exposure_start = begun_;
  if (seen_[0] && seen_[1]) shot_over_.notify_one();
  return frame;
}

void SimStage::BeginShot(UtcTime when, Time time) {
  if (time == Time::kMovesOn && !prepared_) scene_.Advance();
  if (time == Time::kMovesOn) prepared_ = false;
  begun_ = when;
  seen_ = {};
  ++shot_;
  spdlog::debug("sim: shot {} {}, the bin holds {:.9g} m3", shot_, lamp_works_ ? "lit" : "dark",
                scene_.TruthVolume_m3());
}

void SimStage::PrepareShots(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (shot_over_.wait(lock, stop, [this] { return moves_ && !prepared_ && seen_[0] && seen_[1]; })) {
    scene_.Advance();
    (void)scene_.Render(0);
    prepared_ = true;
  }
}

void SimStage::SetLamp(bool works) {
  const std::scoped_lock lock(mutex_);
  lamp_works_ = works;
}

}  // namespace granary
