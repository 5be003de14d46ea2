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

// Hamming distances of one left word against `count` right words that lie at descending addresses from `right`.
// `reversed` holds the right row back to front, so that disparity runs with the address.
void HammingRun(std::uint64_t word, const std::uint64_t* reversed, int count, std::uint8_t* cost) {
  const hn::ScalableTag<std::uint64_t> d64;
  const std::size_t lanes = hn::Lanes(d64);
  const auto left = hn::Set(d64, word);
  HWY_ALIGN std::uint64_t counts[HWY_MAX_BYTES / 8];
  std::size_t d = 0;
  for (; d + lanes <= static_cast<std::size_t>(count); d += lanes) {
    hn::Store(hn::PopulationCount(hn::Xor(left, hn::LoadU(d64, reversed + d))), d64, counts);
    for (std::size_t i = 0; i < lanes; ++i) cost[d + i] = static_cast<std::uint8_t>(counts[i]);
  }
  for (; d < static_cast<std::size_t>(count); ++d) {
    cost[d] = static_cast<std::uint8_t>(hwy::PopCount(word ^ reversed[d]));
  }
}

// One step of one path. `before` and `after` have a guard slot of 65535 on both sides of `stride` slots.
// Returns the minimum of the new path costs; adds them to `sums` (or stores them when `first`).
std::uint16_t PathStep(const std::uint8_t* cost, const std::uint16_t* before, std::uint16_t before_min,
                       std::uint16_t p1, std::uint16_t p2, int stride, bool first, std::uint16_t* after,
                       std::uint16_t* sums) {
  const hn::ScalableTag<std::uint16_t> d16;
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  const std::size_t lanes = hn::Lanes(d16);
  const auto vp1 = hn::Set(d16, p1);
  const auto jump = hn::Set(d16, static_cast<std::uint16_t>(before_min + p2));
  const auto base = hn::Set(d16, before_min);
  auto least = hn::Set(d16, 0xFFFF);
  for (std::size_t d = 0; d < static_cast<std::size_t>(stride); d += lanes) {
    const auto same = hn::LoadU(d16, before + d);
    const auto lower = hn::SaturatedAdd(hn::LoadU(d16, before + d - 1), vp1);
    const auto upper = hn::SaturatedAdd(hn::LoadU(d16, before + d + 1), vp1);
    const auto best = hn::Min(hn::Min(same, jump), hn::Min(lower, upper));
    const auto c = hn::PromoteTo(d16, hn::LoadU(d8, cost + d));
    // Padding slots carry a cost of 255 and stay above every real one; they must not become a minimum.
    const auto value = hn::Add(hn::Sub(best, base), c);
    least = hn::Min(least, value);
    hn::StoreU(value, d16, after + d);
    hn::StoreU(first ? value : hn::Add(hn::LoadU(d16, sums + d), value), d16, sums + d);
  }
  return hn::GetLane(hn::MinOfLanes(d16, least));
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

HWY_EXPORT(HammingRun);
HWY_EXPORT(PathStep);
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

// Row of costs C(x, d), stride slots a pixel.
class CostRows {
 public:
  CostRows(const CensusImage& left, const CensusImage& right, DisparityRange range, int stride, int bits)
      : left_(left), right_(right), range_(range), stride_(stride), bits_(static_cast<std::uint8_t>(bits)) {}

  /// Costs of row y into `cost` (stride slots a pixel).
  void Compute(int y, std::vector<std::uint64_t>& reversed, std::uint8_t* cost) const {
    const int width = left_.width;
    reversed.resize(width);
    const std::uint64_t* right = right_.Row(y);
    std::reverse_copy(right, right + width, reversed.begin());
    const auto hamming = HWY_DYNAMIC_DISPATCH(HammingRun);
    for (int x = 0; x < width; ++x) {
      std::uint8_t* out = cost + static_cast<std::size_t>(x) * stride_;
      // right column = x − min − d must lie in 0 … width − 1
      const int first = std::clamp(x - range_.min_px - (width - 1), 0, range_.count);
      const int last = std::clamp(x - range_.min_px + 1, first, range_.count);
      std::memset(out, bits_, first);
      if (last > first) {
        hamming(left_.Row(y)[x], reversed.data() + (width - 1 - (x - range_.min_px - first)), last - first,
                out + first);
      }
      std::memset(out + last, bits_, range_.count - last);
      std::memset(out + range_.count, 255, stride_ - range_.count);
    }
  }

 private:
  const CensusImage& left_;
  const CensusImage& right_;
  DisparityRange range_;
  int stride_;
  std::uint8_t bits_;
};

// Path costs of one row (or of one step), with guard slots around each pixel.
class PathRow {
 public:
  PathRow(int pixels, int stride)
      : step_(stride + 2), costs_(static_cast<std::size_t>(pixels) * step_, kGuard), minima_(pixels, 0) {}
  std::uint16_t* At(int x) { return costs_.data() + static_cast<std::size_t>(x) * step_ + 1; }
  std::uint16_t& Min(int x) { return minima_[x]; }

 private:
  int step_;
  std::vector<std::uint16_t> costs_;
  std::vector<std::uint16_t> minima_;
};

class Penalty {
 public:
  explicit Penalty(const AggregateOptions& options)
      : p1_(static_cast<std::uint16_t>(options.p1)),
        p2_(static_cast<std::uint16_t>(options.p2)),
        guide_(options.guide),
        scale_(options.guide_scale) {}
  [[nodiscard]] std::uint16_t p1() const { return p1_; }
  /// P2 for the step from (y − dy, x − dx) to (y, x).
  [[nodiscard]] std::uint16_t p2(int y, int x, int dy, int dx) const {
    if (guide_ == nullptr) return p2_;
    const double gradient = std::abs(guide_->at<float>(y, x) - guide_->at<float>(y - dy, x - dx)) * scale_;
    return static_cast<std::uint16_t>(std::max<double>(p1_ + 1, p2_ / std::max(gradient, 1.0)));
  }

 private:
  std::uint16_t p1_, p2_;
  const cv::Mat* guide_;
  double scale_;
};

void SweepRows(const CostRows& costs, const Penalty& penalty, CostSums& out) {
  const auto step = HWY_DYNAMIC_DISPATCH(PathStep);
  tbb::parallel_for(tbb::blocked_range<int>(0, out.height, 4), [&](const tbb::blocked_range<int>& rows) {
    std::vector<std::uint8_t> cost(static_cast<std::size_t>(out.width) * out.stride);
    std::vector<std::uint64_t> reversed;
    const std::vector<std::uint16_t> origin(out.stride + 2, 0);
    PathRow path(2, out.stride);
    for (int y = rows.begin(); y < rows.end(); ++y) {
      costs.Compute(y, reversed, cost.data());
      for (const int direction : {1, -1}) {
        const int start = direction > 0 ? 0 : out.width - 1;
        int now = 0;
        for (int i = 0; i < out.width; ++i) {
          const int x = start + i * direction;
          const bool begins = i == 0;
          const std::uint16_t* before = begins ? origin.data() + 1 : path.At(1 - now);
          path.Min(now) =
              step(cost.data() + static_cast<std::size_t>(x) * out.stride, before, begins ? 0 : path.Min(1 - now),
                   penalty.p1(), begins ? penalty.p1() : penalty.p2(y, x, 0, direction), out.stride, direction > 0,
                   path.At(now), out.At(y, x));
          now = 1 - now;
        }
      }
    }
  });
}

// Paths from the row before (dy = 1: downwards, dy = −1: upwards) with dx = −1, 0, 1. `row_locks` has one mutex a row:
// the sweep that goes down and the one that goes up add to the same sums.
void SweepColumns(const CostRows& costs, const Penalty& penalty, int dy, std::vector<std::mutex>& row_locks,
                  CostSums& out) {
  const auto step = HWY_DYNAMIC_DISPATCH(PathStep);
  const std::vector<std::uint16_t> origin(out.stride + 2, 0);
  std::vector<PathRow> rows[2];
  for (auto& side : rows) {
    for (int i = 0; i < 3; ++i) side.emplace_back(out.width, out.stride);
  }
  std::vector<std::uint8_t> cost(static_cast<std::size_t>(out.width) * out.stride);
  std::vector<std::uint64_t> reversed;
  for (int i = 0; i < out.height; ++i) {
    const int y = dy > 0 ? i : out.height - 1 - i;
    auto& before = rows[i % 2];
    auto& after = rows[1 - i % 2];
    costs.Compute(y, reversed, cost.data());
    const std::scoped_lock lock(row_locks[y]);
    for (int x = 0; x < out.width; ++x) {
      const std::uint8_t* c = cost.data() + static_cast<std::size_t>(x) * out.stride;
      for (int k = 0; k < 3; ++k) {
        const int from = x - (k - 1);
        const bool begins = i == 0 || from < 0 || from >= out.width;
        after[k].Min(x) =
            step(c, begins ? origin.data() + 1 : before[k].At(from), begins ? 0 : before[k].Min(from), penalty.p1(),
                 begins ? penalty.p1() : penalty.p2(y, x, dy, k - 1), out.stride, false, after[k].At(x), out.At(y, x));
      }
    }
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
  out.sums.reset(new std::uint16_t[static_cast<std::size_t>(out.width) * out.height * out.stride]);
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
