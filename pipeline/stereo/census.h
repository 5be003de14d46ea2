// The census transform: each pixel's neighbourhood as a string of comparisons.
#pragma once

#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

namespace granary {

/// One census word a pixel, row-major.
struct CensusImage {
  int width = 0, height = 0;
  std::vector<std::uint64_t> words;
  [[nodiscard]] const std::uint64_t* Row(int y) const {
    return words.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
  }
};

/// Bit k is 1 where the centre is brighter than neighbour k: `ζ(I(p), I(q)) = I(p) <= I(q) ? 0 : 1`.
///
/// Neighbours beyond the border take the border's value. Source: Zhao 2023, §4 (METHOD §3).
/// @param grey H×W, CV_32FC1, finite
/// @param window_width, window_height odd, at most 9×7 (62 neighbours)
[[nodiscard]] CensusImage CensusTransform(const cv::Mat& grey, int window_width, int window_height);

/// Number of comparisons in a window, the largest possible Hamming distance.
[[nodiscard]] constexpr int CensusBits(int window_width, int window_height) { return window_width * window_height - 1; }

}  // namespace granary
