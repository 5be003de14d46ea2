// GigE Vision and USB3 Vision cameras through Aravis.
#pragma once

#include <chrono>
#include <memory>
#include <string>

#include <opencv2/core/types.hpp>

#include "drivers/camera.h"
#include "drivers/options.h"

namespace granary {

/// One GenICam camera under our control, streaming while it is open. Aravis is not thread-safe: one thread, but for
/// Interrupt. A camera that is gone holds a call up for 2.5 s, closing it for 5 s.
///
/// Frames that were under way at Arm are dropped. Of one that a stray trigger began just before, the camera's clock
/// tells with PTP; without, the rig does, by counters and skew.
class CameraAravis final : public Camera {
 public:
  /// Opens the camera that `options.id` names by serial, "Vendor-Serial", MAC or IP, takes control (and makes sure of
  /// it), sets it up and reads every setting back. It tries for control for 3 s, in which the heartbeat of a program
  /// that died runs out.
  /// @param trigger what starts its exposures; kLine0 is the camera's "Line0", or the TriggerSource that
  ///   options.features names
  /// @param size    of the frames where options.roi_px is empty; empty: as large as the sensor
  /// @throws DeviceError: kCameraUnavailable when absent, kCameraInUse when another program holds it, kSettingRefused
  ///   with key, value and what the camera allows
  CameraAravis(const CameraOptions& options, TriggerMode trigger, cv::Size size);
  ~CameraAravis() override;

  [[nodiscard]] std::string Id() const override;
  bool SetExposure(double exposure_us) override;
  void Arm() override;
  void Trigger() override;
  [[nodiscard]] Frame Grab(std::chrono::milliseconds timeout) override;
  void Disarm() noexcept override;
  void Interrupt() noexcept override;

  /// Where two cameras share one link, sets the delay between packets that leaves each its share; where the
  /// configuration sets it, that stays. Nothing for USB cameras. @throws DeviceError
  static void ShareLink(CameraAravis& left, CameraAravis& right);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace granary
