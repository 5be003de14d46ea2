// A picture as a camera gave it, and two of them that belong together.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

namespace granary {

using UtcTime = std::chrono::sys_time<std::chrono::nanoseconds>;

/// One grey picture. Nobody writes into `image` after the frame was made.
struct Frame {
  cv::Mat image;      ///< H×W, CV_8UC1 or CV_16UC1, linear grey
  int bit_depth = 8;  ///< significant bits of a pixel: 8, 10, 12, 14 or 16
  /// The span outside of which no row was exposed, on the host's clock; both 0 where the camera does not tell.
  UtcTime exposure_start{}, exposure_end{};
  /// When the exposure began on the camera's own clock, of unknown zero; empty where it has none.
  std::optional<std::chrono::nanoseconds> device_time;
  std::uint64_t frame_id = 0;  ///< the camera's own counter, or the index of the file
  std::optional<double> temperature_c;  ///< of the camera
  std::string source;          ///< camera id or file, for messages
  bool simulated = false;

  /// The grey value at which a pixel is full.
  [[nodiscard]] int SaturationLevel() const { return (1 << bit_depth) - 1; }
};

/// Two frames of one projector pulse.
struct FramePair {
  Frame left;
  Frame right;
  std::optional<Frame> ambient_left;  ///< the same scene with the projector off
  std::optional<Frame> ambient_right;
  std::optional<std::chrono::microseconds> skew;   ///< |exposure start left − right|; empty when not known
  std::optional<std::chrono::microseconds> pulse;  ///< how long the projector was lit, measured
  [[nodiscard]] bool Simulated() const { return left.simulated || right.simulated; }
};

/// One pair a rig of a bin, in the order of the rigs.
using Shot = std::vector<FramePair>;

}  // namespace granary
