// A camera that plays pictures from files.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "drivers/camera.h"

namespace granary {

/// Each Arm moves to the next file, after the last to the first again; Grab reads it.
class CameraReplay final : public Camera {
 public:
  /// @throws std::invalid_argument when there are no files
  explicit CameraReplay(std::vector<std::filesystem::path> files);

  /// "replay:" and the first file.
  [[nodiscard]] std::string Id() const override;
  void Arm() override;
  /// `frame_id` is the index of the file; `exposure_start` stays at the epoch, as files do not tell it.
  /// @throws DeviceError (kFrameInvalid for a file that cannot be read, kFrameMissing when not armed or already
  /// grabbed)
  [[nodiscard]] Frame Grab(std::chrono::milliseconds timeout) override;
  void Disarm() noexcept override;
  /// Nothing to end: Grab waits for the disk only.
  void Interrupt() noexcept override {}

 private:
  std::vector<std::filesystem::path> files_;
  std::size_t current_ = 0, next_ = 0;
  bool armed_ = false;
};

}  // namespace granary
