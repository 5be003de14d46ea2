// The census transform: each pixel's neighbourhood as a string of comparisons.
#pragma once

#include <cstddef>
#include <cstdint>

#include <opencv2/core/mat.hpp>

#include "pipeline/stereo/raw_array.h"

namespace granary {

/// One census word a pixel, cut into bytes: row by row, and in each row byte by byte, `width` of each.
struct CensusImage {
  int width = 0, height = 0, bytes = 0;
  RawArray<std::uint8_t> planes;

  /// Takes that size; the words have no value yet.
  void Resize(int columns, int rows, int bits) {
    width = columns;
    height = rows;
    bytes = (bits + 7) / 8;
    planes.Reserve(static_cast<std::size_t>(columns) * rows * bytes);
  }
  /// `bytes` planes of `width`.
  [[nodiscard]] const std::uint8_t* Row(int y) const {
    return planes.data() + static_cast<std::size_t>(y) * width * bytes;
  }
  [[nodiscard]] std::uint8_t* Row(int y) { return planes.data() + static_cast<std::size_t>(y) * width * bytes; }
  [[nodiscard]] std::uint64_t Word(int y, int x) const {
    std::uint64_t word = 0;
    for (int k = 0; k < bytes; ++k) word |= std::uint64_t{Row(y)[static_cast<std::size_t>(k) * width + x]} << 8 * k;
    return word;
  }
};

/// Bit k is 1 where the centre is brighter than neighbour k: `ζ(I(p), I(q)) = I(p) <= I(q) ? 0 : 1`.
///
/// Neighbours beyond the border take the border's value. The same for every instruction set and number of threads.
/// Source: Zhao 2023, §4 (METHOD §3).
/// @param grey H×W, CV_32FC1, finite
/// @param window_width, window_height odd, at most 9×7 (62 neighbours)
/// @param census the result; its memory is used again when it is large enough
/// @throws std::invalid_argument for other pictures or windows
void CensusTransform(const cv::Mat& grey, int window_width, int window_height, CensusImage& census);

/// Number of comparisons in a window, the largest possible Hamming distance.
[[nodiscard]] constexpr int CensusBits(int window_width, int window_height) { return window_width * window_height - 1; }

}  // namespace granary
