// The settings of a camera at its opening, each read back. Of camera_aravis*.cpp alone.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include <opencv2/core/types.hpp>

#include "drivers/camera_aravis_features.h"
#include "drivers/options.h"
#include "drivers/pixel_formats.h"

struct _ArvCamera;

namespace granary {

/// What the camera was set to.
struct CameraSettings {
  cv::Size size;
  PixelLayout layout = PixelLayout::kMono8;
  std::uint32_t pixel_format = 0;   ///< as buffers tell it
  std::string exposure_feature;     ///< in microseconds
  std::string temperature_feature;  ///< in degrees Celsius; empty where the camera has none
  bool simulated = false;           ///< Aravis' own fake camera
};

/// Stops the camera and sets all that a configuration says of it, in the order that cameras want it in, but for the
/// delay between packets where it is left open.
/// @param size of the frames where options.roi_px is empty; empty: as large as the sensor
/// @param mtu  of the host's interface, bytes; 0: not known, or no GigE Vision camera
/// @throws DeviceError
[[nodiscard]] CameraSettings SetUpCamera(_ArvCamera& camera, const CameraFeatures& features,
                                         const CameraOptions& options, TriggerMode trigger, cv::Size size, int mtu);

/// @param exposure_us may differ from what the camera does of it by a twentieth: sensors expose whole rows
void SetExposureTime(const CameraFeatures& features, const std::string& exposure_feature, double exposure_us);

/// Of a GigE Vision camera. @throws DeviceError
[[nodiscard]] int PacketSize(_ArvCamera& camera, const CameraFeatures& features);
void SetPacketDelay(_ArvCamera& camera, const CameraFeatures& features, std::int64_t delay_ns);

/// How far the camera's clock is ahead of the host's: 0, or the seconds of atomic time.
/// @throws DeviceError when the camera is not locked to a PTP master, or not to the one that the host follows
[[nodiscard]] std::chrono::seconds CheckPtp(const CameraFeatures& features);

}  // namespace granary
