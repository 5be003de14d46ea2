// USB (UVC) cameras and every other V4L2 capture node.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include <opencv2/core/types.hpp>

#include "drivers/camera.h"
#include "drivers/options.h"
#include "drivers/v4l2_system.h"

namespace granary {

/// What became of the buffers that a node filled, since it was opened.
struct V4l2Counters {
  std::uint64_t frames = 0;   ///< handed out
  std::uint64_t spoilt = 0;   ///< dropped: flagged by the driver, too short, or no whole picture just after the start
  std::uint64_t stale = 0;    ///< dropped: from before Arm, or from before the exposure was changed
  std::uint64_t skipped = 0;  ///< missing in the driver's own count
};

/// One V4L2 capture node, streaming into mapped buffers. A camera on a line streams from Arm to Disarm. One that runs
/// free streams from the first Arm, which waits for its first sound frame, until it is closed: cameras need up to half
/// a second to get going, longer than the projector may be lit. One thread, but for Interrupt.
///
/// Free-running frames tell the span outside of which no row was exposed: up to an exposure and a frame interval before
/// the driver's stamp (end of frame) or after it (start of exposure; both for uvcvideo, which says start of exposure
/// but stamps the arrival of the first packet). Where the exposure is not known it is taken as a frame interval, the
/// most it can be. Of a camera on a line that span would be far too wide for judging one pulse, so its frames carry
/// `device_time` alone, the stamp. frame_id counts on over Arm and starts at 1; 0 where the driver does not count.
class CameraV4l2 final : public Camera {
 public:
  /// Opens the node, sets format, exposure, gain and controls, and reads them back. Nothing automatic stays on. A node
  /// without exposure control is taken as it is, with a warning.
  /// @param trigger what starts its exposures; a node knows no software trigger
  /// @param size    of the frames where options.roi_px is empty; empty: as the node has it
  /// @throws DeviceError: kCameraUnavailable when absent, kCameraInUse when another program streams from it,
  ///   kSettingRefused with key, value and what the node allows
  CameraV4l2(const CameraOptions& options, TriggerMode trigger, cv::Size size, V4l2System& system = KernelV4l2());
  ~CameraV4l2() override;

  [[nodiscard]] std::string Id() const override;
  bool SetExposure(double exposure_us) override;
  void Arm() override;
  [[nodiscard]] Frame Grab(std::chrono::milliseconds timeout) override;
  void Disarm() noexcept override;
  void Interrupt() noexcept override;

  [[nodiscard]] const V4l2Counters& counters() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace granary
