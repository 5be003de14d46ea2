// One way through the picture, and what it carries from row to row.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "pipeline/stereo/aggregate.h"
#include "pipeline/stereo/path_kernels.h"

namespace granary {

inline constexpr int kPaths = 3;  // from the row before: straight on, from the pixel before, from the pixel after
inline constexpr int kMaxRowsInWork = 32;           // of one sweep at a time
inline constexpr double kFullPenaltyGradient = 20;  // grey levels, of 255

/// Path costs of the row before a sweep's next one. Slots move along with the diagonal paths, so that each is read and
/// written in one place: pixel i of row j is slot i, i − j and i + j of the three paths, modulo `ring`.
template <typename Cost>
struct PathSlots {
  int ring = 0, stride = 0;
  Cost* block = nullptr;
  [[nodiscard]] static int Ring(int width) { return width + 2 * kMaxRowsInWork; }
  [[nodiscard]] static std::size_t Count(int ring, int stride) {
    const std::size_t count = static_cast<std::size_t>(kPaths) * ring * (stride + 1);
    return (count + kLaneMultiple - 1) / kLaneMultiple * kLaneMultiple;
  }
  [[nodiscard]] Cost* Path(int k) const { return block + static_cast<std::size_t>(k) * ring * stride; }
  [[nodiscard]] Cost* Least(int k) const { return Path(kPaths) + static_cast<std::size_t>(k) * ring; }
  [[nodiscard]] int Place(int k, int i, int j) const {
    const int place = (k == 0 ? i : k == 1 ? i - j : i + j) % ring;
    return place < 0 ? place + ring : place;
  }
  /// All zero: a path that begins here.
  void Clear(int k, int place) const {
    std::fill_n(Path(k) + static_cast<std::size_t>(place) * stride, stride, Cost{0});
    Least(k)[place] = 0;
  }
  void ClearAll() const { std::fill_n(block, Count(ring, stride), Cost{0}); }
  void CopyFrom(const PathSlots& other) const { std::copy_n(other.block, Count(ring, stride), block); }
};

/// One way through the picture: rows and pixels in reading order, or both backwards.
struct Direction {
  bool forward;
  int width, height;
  [[nodiscard]] int Row(int j) const { return forward ? j : height - 1 - j; }
  [[nodiscard]] int Column(int i) const { return forward ? i : width - 1 - i; }
};

/// P2 of every pixel of a row, in the order of the sweep, for the step from (i − di, j − dj).
template <typename Cost>
void Penalties(const AggregateOptions& options, const Direction& way, int j, int dj, int di, std::vector<Cost>& p2) {
  p2.assign(way.width, static_cast<Cost>(options.p2));
  if (options.guide == nullptr || j - dj < 0) return;
  const float* here = options.guide->ptr<float>(way.Row(j));
  const float* there = options.guide->ptr<float>(way.Row(j - dj));
  for (int i = std::max(0, di); i < std::min(way.width, way.width + di); ++i) {
    const double gradient = std::abs(here[way.Column(i)] - there[way.Column(i - di)]) * options.guide_scale;
    const double penalty = kFullPenaltyGradient * options.p2 / std::max(gradient, kFullPenaltyGradient);
    p2[i] = static_cast<Cost>(std::max<double>(options.p1 + 1, penalty));
  }
}

}  // namespace granary
