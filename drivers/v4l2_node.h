// A V4L2 capture node as plain values: what it is, which pictures it sends, which controls it has.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core/types.hpp>

#include "drivers/errors.h"
#include "drivers/options.h"
#include "drivers/pixel_formats.h"
#include "drivers/v4l2_system.h"

namespace granary {

/// The pictures that a node has been set to send.
struct V4l2Format {
  std::string name;  ///< four characters, without trailing spaces
  PixelLayout layout = PixelLayout::kMono8;
  cv::Size size;
  std::size_t row_bytes = 0;  ///< 0 for JPEG
};

/// One thread. Every method that asks the node throws DeviceError: kCameraUnavailable when it is gone, kCameraInUse
/// when another program holds it, else kSettingRefused.
class V4l2Node {
 public:
  /// Opens `path` (links are resolved now, not later) without blocking and checks that it captures and streams.
  V4l2Node(V4l2System& system, const std::string& path);
  ~V4l2Node();
  V4l2Node(const V4l2Node&) = delete;
  V4l2Node& operator=(const V4l2Node&) = delete;

  /// As named when it was opened.
  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] const std::string& driver() const { return driver_; }
  [[nodiscard]] const std::string& card() const { return card_; }
  [[nodiscard]] const std::string& bus() const { return bus_; }
  [[nodiscard]] int fd() const { return fd_; }
  [[nodiscard]] V4l2System& system() const { return system_; }

  /// Four-character names of all formats that it offers, in its order, without trailing spaces.
  [[nodiscard]] std::vector<std::string> FormatNames() const;
  /// Sets pixel format, size and crop, and makes sure that the node took them as they are.
  /// @param size of the frames where options.roi_px is empty; empty: as the node has it
  [[nodiscard]] V4l2Format SetFormat(const CameraOptions& options, cv::Size size) const;
  /// The nominal time from frame to frame; empty where the node does not tell.
  [[nodiscard]] std::optional<std::chrono::nanoseconds> FrameInterval() const;

  /// One call; a signal starts it anew. @return 0 or errno
  [[nodiscard]] int Try(unsigned long request, void* argument) const;
  /// @param operation what the call is for, as the error is to say
  void Do(unsigned long request, void* argument, const std::string& operation) const;
  /// What errno `error` of this node means.
  [[nodiscard]] DeviceError ErrorOf(int error, const std::string& operation) const;
  [[nodiscard]] DeviceError Refused(const std::string& operation, const std::string& words) const;

 private:
  void CheckCapabilities();
  [[nodiscard]] std::string SizesOf(const std::string& format) const;
  [[nodiscard]] std::string Offers() const;
  /// @return false where the driver cannot crop, and nothing has to be cut out
  [[nodiscard]] bool SetCrop(const std::vector<int>& roi_px) const;
  void CheckCrop(const std::vector<int>& roi_px) const;

  V4l2System& system_;
  std::string path_;
  int fd_;
  std::string driver_, card_, bus_;
};

}  // namespace granary
