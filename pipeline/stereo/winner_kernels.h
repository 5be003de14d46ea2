// The inner loop of winner takes all, on short runs of pixels of one row; lanes as in path_kernels.h.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "pipeline/stereo/path_kernels.h"

namespace granary {

/// Sums of this many disparities share one key range: 6 bits of a key tell them apart.
constexpr int kChunk = 64;
constexpr int kTagBits = 6;

/// Sums and the disparities they belong to, in one word: `S << 6 | place in the chunk`, the least key wins.
template <typename Cost>
using Key = std::conditional_t<sizeof(Cost) == 1, std::uint16_t, std::uint32_t>;

/// Keys of one pixel and chunk lie between guards of all ones.
constexpr int kKeyGuard = kSegment;
constexpr int kKeyStride = kKeyGuard + kChunk + kKeyGuard;

/// Winner takes all for a run of pixels, columns ascending.
template <typename Cost>
struct WinnerRun {
  int x = 0, count = 0;  ///< columns x … x + count − 1
  int width = 0, lanes = 0, stride = 0, offset = 0, first_lane = 0;
  const std::uint8_t* cost = nullptr;  ///< of column x
  const Cost* sums[2] = {};            ///< of column x: four paths each
  std::ptrdiff_t step[3] = {};         ///< from a column to the next one of cost, sums[0], sums[1]
  const Key<Cost>* tags = nullptr;     ///< `stride` values: place in the chunk, all ones past the last lane
  const Key<Cost>* near = nullptr;     ///< of every sum, the greatest key that comes near it as a winner
  Key<Cost>* keys = nullptr;           ///< scratch, kSegment × chunks × kKeyStride, guards set
  std::int16_t* left_index = nullptr;  ///< results, of column x
  float* subpixel = nullptr;
  std::uint8_t* unique = nullptr;
  /// The least sum so far of every right column and the disparity index it belongs to; kRightMargin more on both sides.
  Key<Cost>* right_sum = nullptr;
  Key<Cost>* right_index = nullptr;
};
constexpr int kRightMargin = 2 * (kChunk + kSegment);
void SelectWinners(const WinnerRun<std::uint8_t>& run);
void SelectWinners(const WinnerRun<std::uint16_t>& run);

}  // namespace granary
