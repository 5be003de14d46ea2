// The camera only says when; the bench knows what there is to see.
#include "drivers/sim/camera_sim.h"

#include <utility>

#include "drivers/errors.h"

namespace granary {

CameraSim::CameraSim(std::shared_ptr<SimBench> bench, Side side, const CameraOptions& options)
    : bench_(std::move(bench)),
      side_(side),
      id_(!options.id.empty()   ? options.id
          : side == Side::kLeft ? "sim:left"
                                : "sim:right"),
      exposure_{options.exposure_us, options.gain_db} {}

std::string CameraSim::Id() const { return id_; }

bool CameraSim::SetExposure(double exposure_us) {
  exposure_.exposure_us = exposure_us;
  return true;
}

void CameraSim::Arm() { bench_->Arm(side_); }

Frame CameraSim::Grab(std::chrono::milliseconds) {
  auto frame = bench_->Grab(side_, exposure_);
  if (!frame)
    throw DeviceError(Reason::kFrameMissing, id_, "grab", "the camera is not armed, or its frame was grabbed");
  frame->source = id_;
  return *std::move(frame);
}

void CameraSim::Disarm() noexcept { bench_->Disarm(side_); }

}  // namespace granary
