// Sums and places share one word, so that the least word is the winner and knows where it stands.
#include "pipeline/stereo/winner_kernels.h"

#include <algorithm>
#include <limits>

// Vectors whose size only the processor knows cannot be kept in arrays.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128)
#define HWY_WANT_AVX3_DL
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "pipeline/stereo/winner_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace granary {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Least lane.
template <class D>
HWY_INLINE hn::TFromD<D> LeastLane(D d, hn::Vec<D> v) {
#if HWY_TARGET != HWY_SCALAR
  using K = hn::TFromD<D>;
  const hn::FixedTag<K, 16 / sizeof(K)> d128;
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
  const hn::FixedTag<K, 32 / sizeof(K)> d256;
  const auto half = hn::Min(hn::LowerHalf(d256, v), hn::UpperHalf(d256, v));
  const auto block = hn::Min(hn::LowerHalf(d128, half), hn::UpperHalf(d128, half));
#elif HWY_TARGET == HWY_AVX2
  const auto block = hn::Min(hn::LowerHalf(d128, v), hn::UpperHalf(d128, v));
#else
  const auto block = v;
#endif
  (void)d;
  return hn::GetLane(hn::MinOfLanes(d128, block));
#else
  (void)d;
  return hn::GetLane(v);
#endif
}

// Keys of one pixel, `S << 6 | tag`, and the least of all: sum first, then place, which runs with the disparity.
template <class T>
HWY_INLINE std::uint64_t MakeKeys(const WinnerRun<T>& run, int j, Key<T>* keys) {
  using K = Key<T>;
  const hn::ScalableTag<K> dk;
  const hn::Rebind<T, decltype(dk)> dt;
  const hn::Rebind<std::uint8_t, decltype(dk)> d8;
  const int lanes = static_cast<int>(hn::Lanes(dk));
  const int chunks = run.stride / kChunk;
  constexpr K kNone = std::numeric_limits<K>::max();
  const std::uint8_t* cost = run.cost + j * run.step[0];
  const T* first_sums = run.sums[0] + j * run.step[1];
  const T* second_sums = run.sums[1] + j * run.step[2];
  const int column = run.x + j + run.first_lane + run.offset, slots = std::min(run.stride, run.lanes - run.first_lane);
  const int first = std::clamp(-column, 0, slots), last = std::clamp(run.width - column, first, slots);
  const bool whole = first == 0 && last == slots;
  const auto promote = [&](const T* sums) HWY_ATTR { return hn::PromoteTo(dk, hn::Load(dt, sums)); };
  std::uint64_t best = ~std::uint64_t{0};
  for (int c = 0; c < chunks; ++c, keys += kKeyStride) {
    auto least = hn::Set(dk, kNone);
    for (int q = 0; q < kChunk; q += lanes) {
      const int e = c * kChunk + q;
      const auto eight = hn::ShiftLeft<kTagBits + 3>(hn::PromoteTo(dk, hn::Load(d8, cost + e)));
      const auto excess = hn::ShiftLeft<kTagBits>(hn::Add(promote(first_sums + e), promote(second_sums + e)));
      const auto key = hn::Or(hn::Add(eight, excess), hn::Load(dk, run.tags + e));
      hn::Store(key, dk, keys + q);
      least = hn::Min(least, key);
    }
    if (!whole) {
      const int from = std::clamp(first - c * kChunk, 0, kChunk), to = std::clamp(last - c * kChunk, from, kChunk);
      std::fill(keys, keys + from, kNone);
      std::fill(keys + to, keys + kChunk, kNone);
      least = hn::Set(dk, kNone);
      for (int q = 0; q < kChunk; q += lanes) least = hn::Min(least, hn::Load(dk, keys + q));
    }
    // No branch on what is least: none could be foreseen.
    const std::uint64_t key = LeastLane(dk, least);
    best = std::min(
        best, (key >> kTagBits) << 32 | static_cast<std::uint64_t>(chunks - 1 - c) << kTagBits | (key & (kChunk - 1)));
  }
  return best;
}

// Right columns that chunk c of the run's pixels sees: all pixels at once for each vector of columns, then against what
// was least before. Of equal sums the least disparity wins.
template <class T>
HWY_INLINE void UpdateRight(const WinnerRun<T>& run, int c) {
  using K = Key<T>;
  const hn::ScalableTag<K> dk;
  using V = hn::Vec<decltype(dk)>;
  const int lanes = static_cast<int>(hn::Lanes(dk));
  const int column = run.x + run.first_lane + c * kChunk + run.offset;  // that the first key of the first pixel sees
  if (column >= run.width || column + kChunk + kSegment <= 0) return;
  const std::size_t pixel = static_cast<std::size_t>(run.stride / kChunk) * kKeyStride;
  const V last_index = hn::Set(dk, static_cast<K>(run.lanes - run.first_lane - (c + 1) * kChunk));
  constexpr int kVectors = (kChunk + kSegment) / static_cast<int>(hn::MaxLanes(hn::ScalableTag<K>()));
  constexpr int kAtOnce = kVectors % 3 == 0 ? 3 : 1;
  for (int r = 0; r < kChunk + kSegment; r += kAtOnce * lanes) {
    V least[kAtOnce];
    for (int v = 0; v < kAtOnce; ++v) least[v] = hn::Set(dk, std::numeric_limits<K>::max());
    const K* keys = run.keys + c * kKeyStride + kKeyGuard + r;
    for (int j = 0; j < run.count; ++j, keys += pixel - 1) {
      for (int v = 0; v < kAtOnce; ++v) least[v] = hn::Min(least[v], hn::LoadU(dk, keys + v * lanes));
    }
    for (int v = 0; v < kAtOnce; ++v) {
      K* old_sum_at = run.right_sum + column + r + v * lanes;
      K* old_index_at = run.right_index + column + r + v * lanes;
      const V sum = hn::ShiftRight<kTagBits>(least[v]);
      const V index = hn::Add(last_index, hn::And(least[v], hn::Set(dk, kChunk - 1)));
      const V old_sum = hn::LoadU(dk, old_sum_at), old_index = hn::LoadU(dk, old_index_at);
      const auto better = hn::Or(hn::Lt(sum, old_sum), hn::And(hn::Eq(sum, old_sum), hn::Lt(index, old_index)));
      hn::StoreU(hn::Min(sum, old_sum), dk, old_sum_at);
      hn::StoreU(hn::IfThenElse(better, index, old_index), dk, old_index_at);
    }
  }
}

template <class T>
void SelectWinnerRun(const WinnerRun<T>& run) {
  using K = Key<T>;
  const hn::ScalableTag<K> dk;
  const int lanes = static_cast<int>(hn::Lanes(dk));
  const int chunks = run.stride / kChunk;
  const std::size_t pixel = static_cast<std::size_t>(chunks) * kKeyStride;
  constexpr std::uint64_t kNoSum = std::uint64_t{std::numeric_limits<K>::max() >> kTagBits} << 32;
  std::uint64_t best[kSegment];
  for (int j = 0; j < run.count; ++j) best[j] = MakeKeys(run, j, run.keys + j * pixel + kKeyGuard);

  float rise_down[kSegment], rise_up[kSegment];
  for (int j = 0; j < run.count; ++j) {
    run.left_index[j] = -1;
    run.unique[j] = 0;
    rise_down[j] = rise_up[j] = 0;
    if (best[j] >= kNoSum) continue;
    const K* keys = run.keys + j * pixel + kKeyGuard;
    const int e = run.stride - 1 - static_cast<int>(best[j] & 0xFFFFFFFF);  // lanes run against the disparities
    const int sum = static_cast<int>(best[j] >> 32);
    const K most = run.near[sum];
    const auto limit = hn::Set(dk, most);
    std::size_t rivals = 0;
    for (int c = 0; c < chunks; ++c) {
      for (int q = 0; q < kChunk; q += lanes) {
        const auto key = hn::Load(dk, keys + c * kKeyStride + q);
        rivals += hn::CountTrue(dk, hn::Eq(hn::Min(key, limit), key));
      }
    }
    // Beyond the ends lies a key of all ones: a guard, a lane past the disparities, or one outside the picture.
    const K* here = keys + e / kChunk * kKeyStride + e % kChunk;
    constexpr int kGap = kKeyStride - kChunk;  // from the last key of a chunk to the first of the next
    const K below = here[e % kChunk == 0 && e > 0 ? -1 - kGap : -1];
    const K above = here[e % kChunk == kChunk - 1 && e + 1 < run.stride ? 1 + kGap : 1];
    rivals -= 1u + (below <= most) + (above <= most);
    run.left_index[j] = static_cast<std::int16_t>(run.lanes - 1 - run.first_lane - e);
    run.unique[j] = rivals == 0 ? 255 : 0;
    // At the ends no offset, and none where nothing rises.
    constexpr K kNone = std::numeric_limits<K>::max();
    const bool inside = below != kNone && above != kNone;
    rise_down[j] = inside ? static_cast<float>(static_cast<int>(above >> kTagBits) - sum) : 0.0f;
    rise_up[j] = inside ? static_cast<float>(static_cast<int>(below >> kTagBits) - sum) : 0.0f;
  }
  for (int j = 0; j < run.count; ++j) {
    const float steeper = std::max(std::max(rise_down[j], rise_up[j]), 1.0f);  // sums are whole numbers
    run.subpixel[j] = 0.5f * (rise_down[j] - rise_up[j]) / steeper;
  }

  for (int c = 0; c < chunks; ++c) UpdateRight(run, c);
}

void SelectWinners8(const WinnerRun<std::uint8_t>& run) { SelectWinnerRun(run); }
void SelectWinners16(const WinnerRun<std::uint16_t>& run) { SelectWinnerRun(run); }

}  // namespace HWY_NAMESPACE
}  // namespace granary
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace granary {

HWY_EXPORT(SelectWinners8);
HWY_EXPORT(SelectWinners16);

void SelectWinners(const WinnerRun<std::uint8_t>& run) { HWY_DYNAMIC_DISPATCH(SelectWinners8)(run); }
void SelectWinners(const WinnerRun<std::uint16_t>& run) { HWY_DYNAMIC_DISPATCH(SelectWinners16)(run); }

}  // namespace granary
#endif  // HWY_ONCE
