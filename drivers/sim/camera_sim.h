// One camera of the simulated pair.
#pragma once

#include <memory>

#include "drivers/camera.h"
#include "drivers/options.h"
#include "drivers/sim/bench.h"

namespace granary {

class CameraSim final : public Camera {
 public:
  CameraSim(std::shared_ptr<SimBench> bench, Side side, const CameraOptions& options);

  /// The configured id, else "sim:left" or "sim:right".
  [[nodiscard]] std::string Id() const override;
  bool SetExposure(double exposure_us) override;
  void Arm() override;
  /// Renders at once. @throws DeviceError (kFrameMissing) when not armed, or when the frame was already grabbed.
  [[nodiscard]] Frame Grab(std::chrono::milliseconds timeout) override;
  void Disarm() noexcept override;
  /// Nothing to end: Grab never waits.
  void Interrupt() noexcept override {}

 private:
  std::shared_ptr<SimBench> bench_;
  Side side_;
  std::string id_;
  SimExposure exposure_;
};

}  // namespace granary
