// The inner loops of semi-global matching, on short runs of pixels of one row. Everything about memory, order and
// threads is the caller's; see aggregate.cpp.
//
// Disparities run backwards inside these arrays: lane e of all stands for disparity index count − 1 − e, so that the
// right column grows with the address and the right census row is read as it lies. A pixel may have slots for some of
// the lanes only, from `first_lane` on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace granary {

/// Slots of a pixel are a multiple of this, the 8-bit lanes of the widest vectors (AVX-512).
constexpr int kLaneMultiple = 64;
/// Most pixels in one run.
constexpr int kSegment = 32;
/// Sums of this many disparities share one key range: 6 bits of a key tell them apart.
constexpr int kChunk = 64;
constexpr int kTagBits = 6;

/// Sums and the disparities they belong to, in one word: `S << 6 | place in the chunk`, the least key wins.
template <typename Cost>
using Key = std::conditional_t<sizeof(Cost) == 1, std::uint16_t, std::uint32_t>;

/// Keys of one pixel and chunk lie between guards of all ones.
constexpr int kKeyGuard = kSegment;
constexpr int kKeyStride = kKeyGuard + kChunk + kKeyGuard;

/// The census bytes of a row pair, ready to be compared.
struct CostRow {
  const std::uint8_t* left = nullptr;   ///< `bytes` planes of `width`
  const std::uint8_t* right = nullptr;  ///< as PrepareRight leaves them; place x + e is what lane e of pixel x sees
  std::size_t right_stride = 0;         ///< from plane to plane
  int bytes = 0;                        ///< census bytes a pixel
  int width = 0;
  int lanes = 0;             ///< disparities in all
  int stride = 0;            ///< slots a pixel
  int offset = 0;            ///< right column = x + e + offset
  std::uint8_t outside = 0;  ///< cost where the right column lies outside the picture
};

/// Room that PrepareRight wants for one row, bytes.
[[nodiscard]] std::size_t PreparedPlaneStride(int width, int lanes);
[[nodiscard]] std::size_t PreparedBytes(int width, int lanes, int bytes);

/// Lays the right row's `row.bytes` planes out in `prepared`, which row.right then names.
void PrepareRight(const std::uint8_t* right, const CostRow& row, std::uint8_t* prepared);

/// Hamming distances of `count` pixels beginning at x, one every `step` (±1) columns, `row.stride` slots a pixel from
/// lane `first_lane` on; slots past the last lane get 255.
void ComputeCosts(const CostRow& row, int x, int step, int count, int first_lane, std::uint8_t* cost);

/// Path costs of a run of pixels, in the order of the sweep.
template <typename Cost>
struct PathRun {
  int count = 0, stride = 0;
  const std::uint8_t* cost = nullptr;  ///< from ComputeCosts
  const Cost* padding = nullptr;       ///< `stride` values, all ones past the disparities, else 0
  Cost* paths[3] = {};  ///< L of the row before at the first pixel, `stride` a pixel; this row's is written over it
  Cost* least[3] = {};  ///< and its minimum, one a pixel
  Cost* row_path = nullptr;   ///< L of the pixel before along the row; null leaves this path out
  Cost* row_least = nullptr;  ///< its minimum
  Cost p1 = 0;
  const Cost* p2[4] = {};  ///< of every pixel of the run, path by path, the one along the row last
  Cost* sums = nullptr;    ///< Σ (L − C), `stride` a pixel; null when only the paths are wanted
  std::ptrdiff_t sums_step = 0;
};
/// One run, or two of different rows at once, pixel by pixel in turn: neither may need the same pixel of the other.
void StepPaths(const PathRun<std::uint8_t>& first, const PathRun<std::uint8_t>* second);
void StepPaths(const PathRun<std::uint16_t>& first, const PathRun<std::uint16_t>* second);

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

/// Looks at the processor once; before it, every call above would.
void ChooseInstructionSet();

}  // namespace granary
