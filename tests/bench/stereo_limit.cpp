// A pixel is two groups of four paths, as in a matcher that sweeps twice; the minima of all eight are found together,
// because eight reductions on their own would cost as much as the updates at 128 disparities.
#include "tests/bench/stereo_limit.h"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <thread>

#include <hwy/aligned_allocator.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/bench/stereo_limit.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef GRANARY_LIMIT_STATE
#define GRANARY_LIMIT_STATE
namespace granary {

constexpr int kPaths = 8;
constexpr int kPixels = 8;  ///< whose costs and sums take turns
constexpr int kGuard = 64;  ///< slots before and after each path's costs, so that d ± 1 may be read
constexpr int kP1 = 10, kP2 = 60, kBits = 62;

/// What one thread works on.
struct LimitState {
  explicit LimitState(int count)
      : disparities(count),
        stride(count + 2 * kGuard),
        cost(hwy::AllocateAligned<std::uint8_t>(static_cast<std::size_t>(kPixels) * count)),
        path(hwy::AllocateAligned<std::uint8_t>(static_cast<std::size_t>(2) * kPaths * stride)),
        sums(hwy::AllocateAligned<std::uint16_t>(static_cast<std::size_t>(kPixels) * count)) {
    std::memset(path.get(), 255, static_cast<std::size_t>(2) * kPaths * stride);
    std::uint32_t random = 1;
    for (int i = 0; i < kPixels * count; ++i) {
      random = random * 1664525u + 1013904223u;
      cost[i] = static_cast<std::uint8_t>((random >> 16) % (kBits + 1));
      sums[i] = 0;
    }
    for (int k = 0; k < 2 * kPaths; ++k) std::memset(Path(k), 0, count);
    std::memset(minima, 0, sizeof minima);
  }
  /// Costs of path k before (0 … 7) or after (8 … 15) the update.
  [[nodiscard]] std::uint8_t* Path(int k) const { return path.get() + static_cast<std::size_t>(k) * stride + kGuard; }

  int disparities, stride;
  hwy::AlignedFreeUniquePtr<std::uint8_t[]> cost, path;
  hwy::AlignedFreeUniquePtr<std::uint16_t[]> sums;
  std::uint8_t minima[kPaths];
};

}  // namespace granary
#endif

HWY_BEFORE_NAMESPACE();
namespace granary {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

#if HWY_TARGET == HWY_SCALAR
// No limit worth the name; only there because the dispatch needs a last resort.
void RunByLoad(LimitState& state, LimitState& /*other*/, int pixels) {
  for (int i = 0; i < pixels; ++i) {
    const std::size_t at = static_cast<std::size_t>(i % kPixels) * state.disparities;
    for (int k = 0; k < kPaths; ++k) {
      const std::uint8_t* from = state.Path(i % 2 != 0 ? kPaths + k : k);
      std::uint8_t* to = state.Path(i % 2 != 0 ? k : kPaths + k);
      int low = 255;
      for (int d = 0; d < state.disparities; ++d) {
        const int step = std::min<int>(from[d], std::min<int>(from[d - 1], from[d + 1]) + kP1);
        const int value = std::min(step - state.minima[k], kP2) + state.cost[at + d];
        to[d] = static_cast<std::uint8_t>(value);
        low = std::min(low, value);
        state.sums[at + d] = static_cast<std::uint16_t>((k == 0 ? 0 : state.sums[at + d]) + value);
      }
      state.minima[k] = static_cast<std::uint8_t>(low);
    }
  }
}
void RunByShift(LimitState& state, LimitState& other, int pixels) { RunByLoad(state, other, pixels); }
#else
using D8 = hn::ScalableTag<std::uint8_t>;
using V8 = hn::Vec<D8>;

struct ByLoad {
  static HWY_INLINE V8 Down(D8 d8, const std::uint8_t* at, V8 /*here*/) { return hn::LoadU(d8, at - 1); }
  static HWY_INLINE V8 Up(D8 d8, const std::uint8_t* at, V8 /*here*/) { return hn::LoadU(d8, at + 1); }
};

#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
// Loads that straddle two cache lines count double, and of 64 bytes all do: two shuffles are cheaper.
struct ByShift {
  static HWY_INLINE V8 Down(D8 d8, const std::uint8_t* at, V8 here) {
    const __m512i before = hn::Load(d8, at - 64).raw;
    return V8{_mm512_alignr_epi8(here.raw, _mm512_alignr_epi64(here.raw, before, 6), 15)};
  }
  static HWY_INLINE V8 Up(D8 d8, const std::uint8_t* at, V8 here) {
    const __m512i after = hn::Load(d8, at + 64).raw;
    return V8{_mm512_alignr_epi8(_mm512_alignr_epi64(after, here.raw, 2), here.raw, 1)};
  }
};
#elif HWY_ARCH_X86 && HWY_TARGET == HWY_AVX2
struct ByShift {
  static HWY_INLINE V8 Down(D8 d8, const std::uint8_t* at, V8 here) {
    const __m256i before = hn::Load(d8, at - 32).raw;
    return V8{_mm256_alignr_epi8(here.raw, _mm256_permute2x128_si256(before, here.raw, 0x21), 15)};
  }
  static HWY_INLINE V8 Up(D8 d8, const std::uint8_t* at, V8 here) {
    const __m256i after = hn::Load(d8, at + 32).raw;
    return V8{_mm256_alignr_epi8(_mm256_permute2x128_si256(here.raw, after, 0x21), here.raw, 1)};
  }
};
#else
using ByShift = ByLoad;
#endif

// min(x, m + P2) − m = min(x − m, P2): P2 stays a constant.
template <class Neighbours>
HWY_INLINE V8 Update(D8 d8, const std::uint8_t* HWY_RESTRICT from, std::uint8_t* HWY_RESTRICT to, V8 cost, V8 base,
                     V8 p1, V8 p2, V8& low) {
  const V8 here = hn::Load(d8, from);
  const V8 step = hn::SaturatedAdd(hn::Min(Neighbours::Down(d8, from, here), Neighbours::Up(d8, from, here)), p1);
  const V8 value = hn::Add(hn::Min(hn::Sub(hn::Min(here, step), base), p2), cost);
  hn::Store(value, d8, to);
  low = hn::Min(low, value);
  return value;
}

// Four paths of one pixel; the first group of a pixel sets the sums, the second adds to them. Two path costs fit a byte
// (2 · 122), so pairs are added before they are widened; the sums hold the even disparities of each vector before the
// odd ones, since no one here cares for their order.
template <class Neighbours, bool kFirst>
HWY_INLINE void UpdateFour(const LimitState& state, int k, bool swap, const std::uint8_t* HWY_RESTRICT cost,
                           std::uint16_t* HWY_RESTRICT sums, V8& low0, V8& low1, V8& low2, V8& low3) {
  const D8 d8;
  const hn::Repartition<std::uint16_t, D8> d16;
  const int lanes = static_cast<int>(hn::Lanes(d8));
  const int from = swap ? kPaths : 0, to = kPaths - from;
  const std::uint8_t *from0 = state.Path(from + k), *from1 = state.Path(from + k + 1),
                     *from2 = state.Path(from + k + 2), *from3 = state.Path(from + k + 3);
  std::uint8_t *to0 = state.Path(to + k), *to1 = state.Path(to + k + 1), *to2 = state.Path(to + k + 2),
               *to3 = state.Path(to + k + 3);
  const V8 base0 = hn::Set(d8, state.minima[k]), base1 = hn::Set(d8, state.minima[k + 1]),
           base2 = hn::Set(d8, state.minima[k + 2]), base3 = hn::Set(d8, state.minima[k + 3]);
  const V8 p1 = hn::Set(d8, kP1), p2 = hn::Set(d8, kP2);
  low0 = low1 = low2 = low3 = hn::Set(d8, 255);
  for (int d = 0; d < state.disparities; d += lanes) {
    const V8 c = hn::Load(d8, cost + d);
    const V8 v0 = Update<Neighbours>(d8, from0 + d, to0 + d, c, base0, p1, p2, low0);
    const V8 v1 = Update<Neighbours>(d8, from1 + d, to1 + d, c, base1, p1, p2, low1);
    const V8 v2 = Update<Neighbours>(d8, from2 + d, to2 + d, c, base2, p1, p2, low2);
    const V8 v3 = Update<Neighbours>(d8, from3 + d, to3 + d, c, base3, p1, p2, low3);
    const auto pair0 = hn::BitCast(d16, hn::Add(v0, v1)), pair1 = hn::BitCast(d16, hn::Add(v2, v3));
    const auto odd = hn::Add(hn::ShiftRight<8>(pair0), hn::ShiftRight<8>(pair1));
    const auto even = hn::Sub(hn::Add(pair0, pair1), hn::ShiftLeft<8>(odd));
    std::uint16_t* s = sums + d;
    hn::Store(kFirst ? even : hn::Add(hn::Load(d16, s), even), d16, s);
    hn::Store(kFirst ? odd : hn::Add(hn::Load(d16, s + lanes / 2), odd), d16, s + lanes / 2);
  }
}

// The least byte of each of eight vectors: they are interleaved until every 8 bytes hold one candidate of each.
HWY_INLINE void EightMinima(V8 a, V8 b, V8 c, V8 d, V8 e, V8 f, V8 g, V8 h, std::uint8_t* minima) {
  const D8 d8;
  const hn::Repartition<std::uint16_t, D8> d16;
  const hn::Repartition<std::uint32_t, D8> d32;
  const auto pair = [&](auto tag, V8 u, V8 v) {
    const auto x = hn::BitCast(tag, u), y = hn::BitCast(tag, v);
    return hn::Min(hn::BitCast(d8, hn::InterleaveLower(tag, x, y)), hn::BitCast(d8, hn::InterleaveUpper(tag, x, y)));
  };
  const V8 all = pair(d32, pair(d16, pair(d8, a, b), pair(d8, c, d)), pair(d16, pair(d8, e, f), pair(d8, g, h)));
  const hn::CappedTag<std::uint8_t, 8> d8x8;
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
  const __m256i half = _mm256_min_epu8(_mm512_castsi512_si256(all.raw), _mm512_extracti64x4_epi64(all.raw, 1));
  const __m128i quarter = _mm_min_epu8(_mm256_castsi256_si128(half), _mm256_extracti128_si256(half, 1));
  _mm_storel_epi64(reinterpret_cast<__m128i*>(minima), _mm_min_epu8(quarter, _mm_srli_si128(quarter, 8)));
#elif HWY_ARCH_X86 && HWY_TARGET == HWY_AVX2
  const __m128i half = _mm_min_epu8(_mm256_castsi256_si128(all.raw), _mm256_extracti128_si256(all.raw, 1));
  _mm_storel_epi64(reinterpret_cast<__m128i*>(minima), _mm_min_epu8(half, _mm_srli_si128(half, 8)));
#else
  HWY_ALIGN std::uint8_t bytes[HWY_MAX_BYTES];
  hn::Store(all, d8, bytes);
  auto least = hn::Load(d8x8, bytes);
  for (std::size_t i = 8; i < hn::Lanes(d8); i += 8) least = hn::Min(least, hn::LoadU(d8x8, bytes + i));
  hn::StoreU(least, d8x8, minima);
#endif
  static_cast<void>(d8x8);
}

template <class Neighbours>
HWY_INLINE void UpdatePixel(LimitState& state, int i) {
  const D8 d8;
  V8 a = hn::Zero(d8), b = a, c = a, d = a, e = a, f = a, g = a, h = a;
  const std::size_t at = static_cast<std::size_t>(i % kPixels) * state.disparities;
  const bool swap = i % 2 != 0;
  UpdateFour<Neighbours, true>(state, 0, swap, state.cost.get() + at, state.sums.get() + at, a, b, c, d);
  UpdateFour<Neighbours, false>(state, 4, swap, state.cost.get() + at, state.sums.get() + at, e, f, g, h);
  EightMinima(a, b, c, d, e, f, g, h, state.minima);
}

// Two strangers in turn: while one waits for its minima the other keeps the units busy.
template <class Neighbours>
HWY_INLINE void Run(LimitState& state, LimitState& other, int pixels) {
  for (int i = 0; i < pixels / 2; ++i) {
    UpdatePixel<Neighbours>(state, i);
    UpdatePixel<Neighbours>(other, i);
  }
}

void RunByLoad(LimitState& state, LimitState& other, int pixels) { Run<ByLoad>(state, other, pixels); }
void RunByShift(LimitState& state, LimitState& other, int pixels) { Run<ByShift>(state, other, pixels); }
#endif  // HWY_TARGET == HWY_SCALAR

}  // namespace HWY_NAMESPACE
}  // namespace granary
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace granary {

HWY_EXPORT(RunByLoad);
HWY_EXPORT(RunByShift);

namespace {

using Kernel = void (*)(LimitState&, LimitState&, int);

double UpdatesPerSecond(Kernel kernel, int disparities, int threads) {
  using Clock = std::chrono::steady_clock;
  const int pixels = 40'000'000 / disparities / kPaths;
  std::vector<double> seconds(threads);
  const auto work = [&](int thread) {
    LimitState state(disparities), other(disparities);
    kernel(state, other, pixels);
    double best = 1e9;
    for (int round = 0; round < 12; ++round) {
      const auto begin = Clock::now();
      kernel(state, other, pixels);
      best = std::min(best, std::chrono::duration<double>(Clock::now() - begin).count());
    }
    seconds[thread] = best;
  };
  std::vector<std::jthread> others;
  for (int i = 1; i < threads; ++i) others.emplace_back(work, i);
  work(0);
  others.clear();
  double rate = 0;
  for (const double s : seconds) rate += static_cast<double>(pixels) * disparities * kPaths / s;
  return rate;
}

}  // namespace

std::vector<LimitRate> MeasureLimit(int disparities, int threads) {
  std::vector<LimitRate> rates;
  const std::int64_t supported = hwy::SupportedTargets() & HWY_TARGETS;
  for (std::int64_t rest = supported; rest != 0; rest &= rest - 1) {
    const std::int64_t target = rest & -rest;
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    const Kernel by_load = HWY_DYNAMIC_DISPATCH(RunByLoad), by_shift = HWY_DYNAMIC_DISPATCH(RunByShift);
    const std::string name = hwy::TargetName(target);
    rates.push_back({name + " loads", UpdatesPerSecond(by_load, disparities, threads)});
    rates.push_back({name + " shifts", UpdatesPerSecond(by_shift, disparities, threads)});
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  std::sort(rates.begin(), rates.end(),
            [](const LimitRate& a, const LimitRate& b) { return a.updates_per_s > b.updates_per_s; });
  return rates;
}

}  // namespace granary
#endif  // HWY_ONCE
