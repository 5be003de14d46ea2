// USB (UVC) cameras and every other V4L2 capture node.
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include <opencv2/core/types.hpp>

#include "drivers/camera.h"
#include "drivers/options.h"

namespace granary {

/// One V4L2 capture node, streaming into mapped buffers from Arm to Disarm. One thread, but for Interrupt.
class CameraV4l2 final : public Camera {
 public:
  /// Opens the node, sets format, exposure, gain and controls, and reads them back.
  /// @param trigger what starts its exposures; a node knows no software trigger
  /// @param size    of the frames where options.roi_px is empty; empty: as the node has it
  /// @throws DeviceError: kCameraUnavailable when absent, kCameraInUse when another program streams from it,
  ///   kSettingRefused with key, value and what the node allows
  CameraV4l2(const CameraOptions& options, TriggerMode trigger, cv::Size size);
  ~CameraV4l2() override;

  [[nodiscard]] std::string Id() const override;
  bool SetExposure(double exposure_us) override;
  void Arm() override;
  [[nodiscard]] Frame Grab(std::chrono::milliseconds timeout) override;
  void Disarm() noexcept override;
  void Interrupt() noexcept override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace granary
