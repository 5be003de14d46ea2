// A moved scene costs half a second to light, on a busy machine more than a client waits for its frame: a second scene
// is moved and lit ahead, and the two change places.
#include "drivers/sim/stage.h"

#include <utility>

#include <spdlog/spdlog.h>

namespace granary {
namespace {

std::future<SimScene> MoveAhead(SimScene scene, int steps) {
  return std::async(std::launch::async, [scene = std::move(scene), steps]() mutable {
    for (int i = 0; i < steps; ++i) scene.Advance();
    (void)scene.Render(0);  // keeps the light
    return std::move(scene);
  });
}

}  // namespace

SimStage::SimStage(const SimOptions& options, const RigWorld& world) : scene_(options, world) {
  (void)scene_.Render(0);
  if (options.motion != SimMotion::kStill && !world.empty_bin) next_ = MoveAhead(SimScene(options, world), 1);
}

Frame SimStage::TakePicture(Side side, UtcTime when, const SimExposure& exposure) {
  const std::scoped_lock lock(mutex_);
  bool& seen = seen_.at(static_cast<std::size_t>(side));
  if (shot_ == 0 || seen || when - begun_ > kShotSpan) BeginShot(when);
  seen = true;
  Frame frame = scene_.RenderSide(side, shot_, lamp_works_, exposure);
  frame.exposure_start = begun_;
  return frame;
}

void SimStage::BeginShot(UtcTime when) {
  if (next_.valid() && shot_ > 0 && when - begun_ > kPause) {
    SimScene behind = std::exchange(scene_, next_.get());
    next_ = MoveAhead(std::move(behind), 2);
  }
  begun_ = when;
  seen_ = {};
  ++shot_;
  spdlog::debug("sim: shot {} {}, the bin holds {:.9g} m3", shot_, lamp_works_ ? "lit" : "dark",
                scene_.TruthVolume_m3());
}

void SimStage::SetLamp(bool works) {
  const std::scoped_lock lock(mutex_);
  lamp_works_ = works;
}

}  // namespace granary
