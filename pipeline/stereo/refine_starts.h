// Where a pixel's surface runs and which window near it lies on that surface, for a band of rows.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "pipeline/stereo/refine_rows.h"

namespace granary {

/// Where the window that a pixel uses lies: its own (the first), or one of two rings around it.
struct WindowOffset {
  int dx, dy;
  bool far;
};
using WindowOffsets = std::array<WindowOffset, 17>;
[[nodiscard]] WindowOffsets MakeWindowOffsets(int radius);
constexpr std::uint8_t kNoWindow = 255;

/// What one thread needs to fit planes in a band; used again for the next band.
class StartBuffers {
 public:
  StartBuffers(int radius, int width);

 private:
  friend void FindStarts(const cv::Mat&, int, int, int, int, StartBuffers&, cv::Mat&, cv::Mat&);
  RowRing sums_, none_, value_, slope_x_, slope_y_, variance_;
  std::vector<std::int32_t> contested_;
};

/// Fits planes to the disparities of every window of the rows y0 … y1 − 1 and gives each pixel that of its own window
/// or, where that straddles a step, of one beside it which lies on the pixel's surface.
/// @param disparity_px CV_32FC1, RefineWidth(width) columns, +inf invalid and beyond `width`
/// @param[out] start_px the plane's value at the pixel, NaN where it has no window; as wide as `disparity_px`
/// @param[out] window CV_8UC1, H×width, which of MakeWindowOffsets, or kNoWindow
void FindStarts(const cv::Mat& disparity_px, int width, int radius, int y0, int y1, StartBuffers& buffers,
                cv::Mat& start_px, cv::Mat& window);

}  // namespace granary
