// Three sweeps over the picture share one volume of sums. Horizontal paths stay inside a row, so rows run in parallel;
// the three downward and the three upward paths need the row before: the two sweeps run side by side, and since whole
// numbers add up in any order, the sums do not depend on which of them reaches a row first.
// Costs are recomputed from the census words wherever they are needed: a popcount is cheaper than a volume of bytes.
#include "pipeline/stereo/aggregate.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <mutex>
#include <stdexcept>
#include <vector>

#include "pipeline/large_pages.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "pipeline/stereo/aggregate.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace granary {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Hamming distances of one left word against `count` right words; `reversed` is the right row back to front, so that
// the disparity runs with the address.
void HammingRun(std::uint64_t word, const std::uint64_t* HWY_RESTRICT reversed, int count,
                std::uint8_t* HWY_RESTRICT cost) {
  const hn::ScalableTag<std::uint64_t> d64;
  const hn::Rebind<std::uint8_t, decltype(d64)> d8;
  const std::size_t lanes = hn::Lanes(d64);
  const auto left = hn::Set(d64, word);
  std::size_t d = 0;
  for (; d + lanes <= static_cast<std::size_t>(count); d += lanes) {
    const auto bits = hn::PopulationCount(hn::Xor(left, hn::LoadU(d64, reversed + d)));
    hn::StoreU(hn::TruncateTo(d8, bits), d8, cost + d);
  }
  for (; d < static_cast<std::size_t>(count); ++d) {
    cost[d] = static_cast<std::uint8_t>(hwy::PopCount(word ^ reversed[d]));
  }
}

// Costs C(x, d) of one row, `stride` slots a pixel. The right column x − min − d must lie in 0 … width − 1.
void CostRow(const std::uint64_t* left, const std::uint64_t* reversed, int width, DisparityRange range, int stride,
             std::uint8_t bits, std::uint8_t* cost) {
  for (int x = 0; x < width; ++x, cost += stride) {
    const int first = std::clamp(x - range.min_px - (width - 1), 0, range.count);
    const int last = std::clamp(x - range.min_px + 1, first, range.count);
    std::memset(cost, bits, first);
    if (last > first)
      HammingRun(left[x], reversed + (width - 1 - (x - range.min_px - first)), last - first, cost + first);
    std::memset(cost + last, bits, range.count - last);
    // Padding slots carry a cost no real one reaches, so that they never become a minimum.
    std::memset(cost + range.count, 255, stride - range.count);
  }
}

// L_r(p, ·) for one vector of disparities from L_r(p − r, ·), which has a guard slot on both sides.
template <class D16>
HWY_INLINE hn::Vec<D16> PathValue(D16 d16, const std::uint16_t* before, hn::Vec<D16> jump, hn::Vec<D16> base,
                                  hn::Vec<D16> p1, hn::Vec<D16> cost) {
  const auto step = hn::SaturatedAdd(hn::Min(hn::LoadU(d16, before - 1), hn::LoadU(d16, before + 1)), p1);
  const auto best = hn::Min(hn::Min(hn::LoadU(d16, before), jump), step);
  return hn::Add(hn::Sub(best, base), cost);
}

// The two paths along a row; the first of them sets the sums. `path` has two rows of stride + 2 slots, `p2[x]` is the
// penalty between x − 1 and x.
void SweepRow(const std::uint8_t* cost, int width, int stride, std::uint16_t p1, const std::uint16_t* p2,
              std::uint16_t* path, std::uint16_t* sums) {
  const hn::ScalableTag<std::uint16_t> d16;
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  const auto vp1 = hn::Set(d16, p1);
  for (const int direction : {1, -1}) {
    std::uint16_t* before = path + 1;
    std::uint16_t* after = path + stride + 3;
    std::fill(before, before + stride, std::uint16_t{0});
    std::uint16_t least = 0;
    for (int i = 0; i < width; ++i) {
      const int x = direction > 0 ? i : width - 1 - i;
      const std::uint16_t penalty = i == 0 ? p1 : p2[direction > 0 ? x : x + 1];
      const auto jump = hn::Set(d16, static_cast<std::uint16_t>(least + penalty));
      const auto base = hn::Set(d16, least);
      const std::uint8_t* c = cost + static_cast<std::size_t>(x) * stride;
      std::uint16_t* s = sums + static_cast<std::size_t>(x) * stride;
      auto low = hn::Set(d16, 0xFFFF);
      for (int d = 0; d < stride; d += lanes) {
        const auto value = PathValue(d16, before + d, jump, base, vp1, hn::PromoteTo(d16, hn::LoadU(d8, c + d)));
        low = hn::Min(low, value);
        hn::StoreU(value, d16, after + d);
        hn::StoreU(direction > 0 ? value : hn::Add(hn::LoadU(d16, s + d), value), d16, s + d);
      }
      least = hn::GetLane(hn::MinOfLanes(d16, low));
      std::swap(before, after);
    }
  }
}

// The three paths that come from the row before, with dx = −1, 0, 1, added to the sums of one row. Pixel x of path k
// lies at `rows[k] + x · (stride + 2) + 1`; its minimum at `minima[k][x]`; both arrays have one pixel more at either
// end, which stand for the border.
void SweepStep(const std::uint8_t* cost, int width, int stride, std::uint16_t p1, const std::uint16_t* const p2[3],
               const std::uint16_t* const before[3], const std::uint16_t* const before_minima[3],
               std::uint16_t* const after[3], std::uint16_t* const after_minima[3], std::uint16_t* sums) {
  const hn::ScalableTag<std::uint16_t> d16;
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  const auto vp1 = hn::Set(d16, p1);
  const std::ptrdiff_t step = stride + 2;
  for (int x = 0; x < width; ++x) {
    const std::uint16_t* from0 = before[0] + (x - 1) * step + 1;
    const std::uint16_t* from1 = before[1] + x * step + 1;
    const std::uint16_t* from2 = before[2] + (x + 1) * step + 1;
    const std::uint16_t m0 = before_minima[0][x - 1], m1 = before_minima[1][x], m2 = before_minima[2][x + 1];
    const auto jump0 = hn::Set(d16, static_cast<std::uint16_t>(m0 + p2[0][x])), base0 = hn::Set(d16, m0);
    const auto jump1 = hn::Set(d16, static_cast<std::uint16_t>(m1 + p2[1][x])), base1 = hn::Set(d16, m1);
    const auto jump2 = hn::Set(d16, static_cast<std::uint16_t>(m2 + p2[2][x])), base2 = hn::Set(d16, m2);
    std::uint16_t* to0 = after[0] + x * step + 1;
    std::uint16_t* to1 = after[1] + x * step + 1;
    std::uint16_t* to2 = after[2] + x * step + 1;
    const std::uint8_t* c = cost + static_cast<std::size_t>(x) * stride;
    std::uint16_t* s = sums + static_cast<std::size_t>(x) * stride;
    auto low0 = hn::Set(d16, 0xFFFF), low1 = low0, low2 = low0;
    for (int d = 0; d < stride; d += lanes) {
      const auto vc = hn::PromoteTo(d16, hn::LoadU(d8, c + d));
      const auto v0 = PathValue(d16, from0 + d, jump0, base0, vp1, vc);
      const auto v1 = PathValue(d16, from1 + d, jump1, base1, vp1, vc);
      const auto v2 = PathValue(d16, from2 + d, jump2, base2, vp1, vc);
      low0 = hn::Min(low0, v0);
      low1 = hn::Min(low1, v1);
      low2 = hn::Min(low2, v2);
      hn::StoreU(v0, d16, to0 + d);
      hn::StoreU(v1, d16, to1 + d);
      hn::StoreU(v2, d16, to2 + d);
      hn::StoreU(hn::Add(hn::LoadU(d16, s + d), hn::Add(v0, hn::Add(v1, v2))), d16, s + d);
    }
    after_minima[0][x] = hn::GetLane(hn::MinOfLanes(d16, low0));
    after_minima[1][x] = hn::GetLane(hn::MinOfLanes(d16, low1));
    after_minima[2][x] = hn::GetLane(hn::MinOfLanes(d16, low2));
  }
}

// Updates the best sum and disparity of the right pixels that one left pixel's sums belong to; `sums` begins at
// disparity index `first`.
void UpdateRight(const std::uint16_t* sums, int first, int count, std::uint16_t* best, std::uint16_t* index) {
  const hn::ScalableTag<std::uint16_t> d16;
  const std::size_t lanes = hn::Lanes(d16);
  std::size_t d = 0;
  for (; d + lanes <= static_cast<std::size_t>(count); d += lanes) {
    const auto value = hn::LoadU(d16, sums + d);
    const auto old = hn::LoadU(d16, best + d);
    const auto better = hn::Lt(value, old);
    hn::StoreU(hn::Min(value, old), d16, best + d);
    const auto here = hn::Add(hn::Iota(d16, 0), hn::Set(d16, static_cast<std::uint16_t>(first + d)));
    hn::StoreU(hn::IfThenElse(better, here, hn::LoadU(d16, index + d)), d16, index + d);
  }
  for (; d < static_cast<std::size_t>(count); ++d) {
    if (sums[d] < best[d]) {
      best[d] = sums[d];
      index[d] = static_cast<std::uint16_t>(first + d);
    }
  }
}

// Smallest of `count` sums.
std::uint16_t LeastSum(const std::uint16_t* sums, int count) {
  const hn::ScalableTag<std::uint16_t> d16;
  const std::size_t lanes = hn::Lanes(d16);
  auto least = hn::Set(d16, 0xFFFF);
  std::size_t d = 0;
  for (; d + lanes <= static_cast<std::size_t>(count); d += lanes) least = hn::Min(least, hn::LoadU(d16, sums + d));
  std::uint16_t result = hn::GetLane(hn::MinOfLanes(d16, least));
  for (; d < static_cast<std::size_t>(count); ++d) result = std::min(result, sums[d]);
  return result;
}

}  // namespace HWY_NAMESPACE
}  // namespace granary
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace granary {

HWY_EXPORT(CostRow);
HWY_EXPORT(SweepRow);
HWY_EXPORT(SweepStep);
HWY_EXPORT(UpdateRight);
HWY_EXPORT(LeastSum);

namespace {

// A function pointer taken before the processor was looked at would look at it again on every call.
void ChooseInstructionSet() {
  static const bool chosen = (hwy::GetChosenTarget().Update(hwy::SupportedTargets()), true);
  static_cast<void>(chosen);
}

constexpr int kLaneMultiple = 32;  // 16-bit lanes of the widest vectors (AVX-512)
constexpr std::uint16_t kGuard = 0xFFFF;

// The costs of any row, recomputed from the census words.
class CostRows {
 public:
  CostRows(const CensusImage& left, const CensusImage& right, DisparityRange range, int stride, int bits)
      : left_(left), right_(right), range_(range), stride_(stride), bits_(static_cast<std::uint8_t>(bits)) {}

  /// Costs of row y, stride slots a pixel; `reversed` is scratch.
  void Compute(int y, std::vector<std::uint64_t>& reversed, std::vector<std::uint8_t>& cost) const {
    reversed.resize(left_.width);
    cost.resize(static_cast<std::size_t>(left_.width) * stride_);
    std::reverse_copy(right_.Row(y), right_.Row(y) + left_.width, reversed.begin());
    HWY_DYNAMIC_DISPATCH(CostRow)(left_.Row(y), reversed.data(), left_.width, range_, stride_, bits_, cost.data());
  }

 private:
  const CensusImage& left_;
  const CensusImage& right_;
  DisparityRange range_;
  int stride_;
  std::uint8_t bits_;
};

// Path costs and minima of one row for three directions, with a border pixel of zeros at either end and guard slots
// around each pixel.
class PathRows {
 public:
  PathRows(int width, int stride) : step_(stride + 2) {
    for (int k = 0; k < 3; ++k) {
      costs_[k].assign(static_cast<std::size_t>(width + 2) * step_, 0);
      for (std::size_t at = 0; at < costs_[k].size(); at += step_) costs_[k][at] = costs_[k][at + step_ - 1] = kGuard;
      minima_[k].assign(width + 2, 0);
    }
  }
  std::uint16_t* Costs(int k) { return costs_[k].data() + step_; }
  std::uint16_t* Minima(int k) { return minima_[k].data() + 1; }

 private:
  int step_;
  std::vector<std::uint16_t> costs_[3], minima_[3];
};

class Penalty {
 public:
  explicit Penalty(const AggregateOptions& options)
      : p1_(static_cast<std::uint16_t>(options.p1)),
        p2_(static_cast<std::uint16_t>(options.p2)),
        guide_(options.guide),
        scale_(options.guide_scale) {}
  [[nodiscard]] std::uint16_t p1() const { return p1_; }
  /// P2 of every pixel of row y for the step that comes from (y − dy, x − dx).
  void Row(int y, int dy, int dx, int width, int height, std::vector<std::uint16_t>& p2) const {
    p2.assign(width, p2_);
    if (guide_ == nullptr || y - dy < 0 || y - dy >= height) return;
    const float* here = guide_->ptr<float>(y);
    const float* there = guide_->ptr<float>(y - dy);
    for (int x = std::max(0, dx); x < std::min(width, width + dx); ++x) {
      const double gradient = std::abs(here[x] - there[x - dx]) * scale_;
      p2[x] = static_cast<std::uint16_t>(std::max<double>(p1_ + 1, p2_ / std::max(gradient, 1.0)));
    }
  }

 private:
  std::uint16_t p1_, p2_;
  const cv::Mat* guide_;
  double scale_;
};

void SweepRows(const CostRows& costs, const Penalty& penalty, CostSums& out) {
  const auto sweep = HWY_DYNAMIC_DISPATCH(SweepRow);
  tbb::parallel_for(tbb::blocked_range<int>(0, out.height, 4), [&](const tbb::blocked_range<int>& rows) {
    std::vector<std::uint8_t> cost;
    std::vector<std::uint64_t> reversed;
    std::vector<std::uint16_t> path(2 * (out.stride + 2), kGuard), p2;
    for (int y = rows.begin(); y < rows.end(); ++y) {
      costs.Compute(y, reversed, cost);
      penalty.Row(y, 0, 1, out.width, out.height, p2);
      sweep(cost.data(), out.width, out.stride, penalty.p1(), p2.data(), path.data(), out.At(y, 0));
    }
  });
}

// Paths from the row before (dy = 1: downwards, dy = −1: upwards) with dx = 1, 0, −1. `row_locks` has one mutex a row:
// the sweep that goes down and the one that goes up add to the same sums.
void SweepColumns(const CostRows& costs, const Penalty& penalty, int dy, std::vector<std::mutex>& row_locks,
                  CostSums& out) {
  const auto step = HWY_DYNAMIC_DISPATCH(SweepStep);
  PathRows rows[2] = {PathRows(out.width, out.stride), PathRows(out.width, out.stride)};
  std::vector<std::uint8_t> cost;
  std::vector<std::uint64_t> reversed;
  std::vector<std::uint16_t> p2[3];
  for (int i = 0; i < out.height; ++i) {
    const int y = dy > 0 ? i : out.height - 1 - i;
    PathRows &before = rows[i % 2], &after = rows[1 - i % 2];
    costs.Compute(y, reversed, cost);
    for (int k = 0; k < 3; ++k) penalty.Row(y, dy, 1 - k, out.width, out.height, p2[k]);
    const std::uint16_t* const p2s[3] = {p2[0].data(), p2[1].data(), p2[2].data()};
    const std::uint16_t* const from[3] = {before.Costs(0), before.Costs(1), before.Costs(2)};
    const std::uint16_t* const from_minima[3] = {before.Minima(0), before.Minima(1), before.Minima(2)};
    std::uint16_t* const to[3] = {after.Costs(0), after.Costs(1), after.Costs(2)};
    std::uint16_t* const to_minima[3] = {after.Minima(0), after.Minima(1), after.Minima(2)};
    const std::scoped_lock lock(row_locks[y]);
    step(cost.data(), out.width, out.stride, penalty.p1(), p2s, from, from_minima, to, to_minima, out.At(y, 0));
  }
}

}  // namespace

CostSums AggregateCosts(const CensusImage& left, const CensusImage& right, DisparityRange range,
                        const AggregateOptions& options) {
  if (left.width != right.width || left.height != right.height || left.words.empty()) {
    throw std::invalid_argument("aggregation: the pictures must have one size and not be empty");
  }
  if (range.count < 1) throw std::invalid_argument("aggregation: the disparity range is empty");
  ChooseInstructionSet();
  CostSums out;
  out.width = left.width;
  out.height = left.height;
  out.count = range.count;
  out.stride = (range.count + kLaneMultiple - 1) / kLaneMultiple * kLaneMultiple;
  out.sums = MakeLarge<std::uint16_t>(static_cast<std::size_t>(out.width) * out.height * out.stride);
  const CostRows costs(left, right, range, out.stride, options.census_bits);
  const Penalty penalty(options);
  SweepRows(costs, penalty, out);
  std::vector<std::mutex> row_locks(out.height);
  tbb::parallel_invoke([&] { SweepColumns(costs, penalty, 1, row_locks, out); },
                       [&] { SweepColumns(costs, penalty, -1, row_locks, out); });
  return out;
}

Winners TakeWinners(const CostSums& sums, DisparityRange range, double uniqueness) {
  const int width = sums.width, height = sums.height, count = sums.count;
  ChooseInstructionSet();
  Winners winners;
  winners.left_index.create(height, width, CV_16SC1);
  winners.right_index.create(height, width, CV_16SC1);
  winners.subpixel.create(height, width, CV_32FC1);
  winners.unique.create(height, width, CV_8UC1);
  const auto update_right = HWY_DYNAMIC_DISPATCH(UpdateRight);
  const auto least_sum = HWY_DYNAMIC_DISPATCH(LeastSum);
  tbb::parallel_for(tbb::blocked_range<int>(0, height, 8), [&](const tbb::blocked_range<int>& rows) {
    std::vector<std::uint16_t> best(static_cast<std::size_t>(width) + count), index(best.size());
    for (int y = rows.begin(); y < rows.end(); ++y) {
      std::fill(best.begin(), best.end(), kGuard);
      std::int16_t* left_out = winners.left_index.ptr<std::int16_t>(y);
      float* offset = winners.subpixel.ptr<float>(y);
      std::uint8_t* unique = winners.unique.ptr<std::uint8_t>(y);
      for (int x = 0; x < width; ++x) {
        const std::uint16_t* s = sums.At(y, x);
        const int first = std::clamp(x - range.min_px - (width - 1), 0, count);
        const int last = std::clamp(x - range.min_px + 1, first, count);
        left_out[x] = -1;
        offset[x] = 0;
        unique[x] = 0;
        if (last == first) continue;
        // slot = (width − 1 − right column): runs with d
        const int slot = width - 1 - (x - range.min_px - first);
        update_right(s + first, first, last - first, best.data() + slot, index.data() + slot);
        const std::uint16_t least = least_sum(s + first, last - first);
        const int d = static_cast<int>(std::find(s + first, s + last, least) - s);
        left_out[x] = static_cast<std::int16_t>(d);
        const double limit = least * (1.0 + uniqueness);
        const auto rivals = [&](int from, int to) { return to > from && least_sum(s + from, to - from) <= limit; };
        unique[x] = rivals(first, d - 1) || rivals(d + 2, last) ? 0 : 255;
        if (d > first && d + 1 < last) {
          const float down = static_cast<float>(s[d - 1]) - s[d], up = static_cast<float>(s[d + 1]) - s[d];
          const float steeper = std::max(down, up);
          offset[x] = steeper > 0 ? 0.5f * (down - up) / steeper : 0.0f;
        }
      }
      std::int16_t* right_out = winners.right_index.ptr<std::int16_t>(y);
      for (int x = 0; x < width; ++x) {
        const int slot = width - 1 - x;
        right_out[x] = best[slot] == kGuard ? std::int16_t{-1} : static_cast<std::int16_t>(index[slot]);
      }
    }
  });
  return winners;
}

}  // namespace granary
#endif  // HWY_ONCE
