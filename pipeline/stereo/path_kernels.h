// The inner loops of semi-global matching, on short runs of pixels of one row. Everything about memory, order and
// threads is the caller's; see aggregate.cpp.
//
// Disparities run backwards inside these arrays: lane e of all stands for disparity index count − 1 − e, so that the
// right column grows with the address and the right census row is read as it lies. A pixel may have slots for some of
// the lanes only, from `first_lane` on.
#pragma once

#include <cstddef>
#include <cstdint>

namespace granary {

/// Slots of a pixel are a multiple of this, the 8-bit lanes of the widest vectors (AVX-512).
constexpr int kLaneMultiple = 64;
/// Most pixels in one run.
constexpr int kSegment = 32;

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
  Cost* row_path = nullptr;   ///< L of the pixel before along the row; followed only where sums are wanted
  Cost* row_least = nullptr;  ///< its minimum
  Cost p1 = 0;
  const Cost* p2[4] = {};  ///< of every pixel of the run, path by path, the one along the row last
  Cost* sums = nullptr;    ///< Σ (L − C), `stride` a pixel; null when only the paths are wanted
  std::ptrdiff_t sums_step = 0;
};
/// One run, or two of different rows at once, pixel by pixel in turn: neither may need the same pixel of the other.
void StepPaths(const PathRun<std::uint8_t>& first, const PathRun<std::uint8_t>* second);
void StepPaths(const PathRun<std::uint16_t>& first, const PathRun<std::uint16_t>* second);

/// Looks at the processor once; before it, every call above would.
void ChooseInstructionSet();

}  // namespace granary
