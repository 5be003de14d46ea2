// Written once and compiled for every instruction set. A path's costs of the row before are read and overwritten in
// place; what a lane needs of its neighbours d ± 1 is shifted in registers, since loads off the grain cost more.
// Path costs are kept without C in the sums, Σ (L − C) ≤ 4·P2, so that bytes hold them; winner_kernels.cpp brings C
// back.
#include "pipeline/stereo/path_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

// Vectors whose size only the processor knows cannot be members of a struct.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128)
#define HWY_WANT_AVX3_DL
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "pipeline/stereo/path_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

// Byte population counts are one instruction, or else two table lookups: then nibbles are kept apart from the start.
#undef GRANARY_NIBBLES
#if (HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3_DL) || HWY_ARCH_ARM || HWY_TARGET == HWY_SCALAR
#define GRANARY_NIBBLES 0
#else
#define GRANARY_NIBBLES 1
#endif

HWY_BEFORE_NAMESPACE();
namespace granary {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Lane i of the result is lane i − 1 of `here`, lane 0 the last of `before`.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V FromLaneBefore(D d, V before, V here) {
#if HWY_TARGET == HWY_SCALAR
  (void)d, (void)here;
  return before;
#else
  constexpr int kBytes = 16 - sizeof(hn::TFromD<D>);
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
  return hn::CombineShiftRightBytes<kBytes>(d, here, V{_mm512_alignr_epi32(here.raw, before.raw, 12)});
#elif HWY_TARGET == HWY_AVX2
  return hn::CombineShiftRightBytes<kBytes>(d, here, hn::ConcatLowerUpper(d, here, before));
#else
  return hn::CombineShiftRightBytes<kBytes>(d, here, before);
#endif
#endif
}

// Lane i of the result is lane i + 1 of `here`, the last one lane 0 of `after`.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V FromLaneAfter(D d, V here, V after) {
#if HWY_TARGET == HWY_SCALAR
  (void)d, (void)here;
  return after;
#else
  constexpr int kBytes = sizeof(hn::TFromD<D>);
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
  return hn::CombineShiftRightBytes<kBytes>(d, V{_mm512_alignr_epi32(after.raw, here.raw, 4)}, here);
#elif HWY_TARGET == HWY_AVX2
  return hn::CombineShiftRightBytes<kBytes>(d, hn::ConcatLowerUpper(d, after, here), here);
#else
  return hn::CombineShiftRightBytes<kBytes>(d, after, here);
#endif
#endif
}

// Minima of four vectors.
template <class D, class V = hn::Vec<D>>
HWY_INLINE void Minima(D d, V a, V b, V c, V e, hn::TFromD<D>* out) {
#if HWY_TARGET != HWY_SCALAR
  if constexpr (sizeof(hn::TFromD<D>) == 1) {
    // Four reductions at once: lanes of 32 bits, then of 64, change places until each path has one 32-bit lane.
    const hn::Repartition<std::uint32_t, D> d32;
    const hn::Repartition<std::uint64_t, D> d64;
    const auto pairs = [&](V p, V q) {
      const auto p32 = hn::BitCast(d32, p), q32 = hn::BitCast(d32, q);
      return hn::Min(hn::BitCast(d, hn::InterleaveLower(d32, p32, q32)),
                     hn::BitCast(d, hn::InterleaveUpper(d32, p32, q32)));
    };
    const auto ab = hn::BitCast(d64, pairs(a, b)), ce = hn::BitCast(d64, pairs(c, e));
    const auto all =
        hn::Min(hn::BitCast(d, hn::InterleaveLower(d64, ab, ce)), hn::BitCast(d, hn::InterleaveUpper(d64, ab, ce)));
    const hn::FixedTag<std::uint8_t, 16> d128;
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
    const hn::FixedTag<std::uint8_t, 32> d256;
    const auto half = hn::Min(hn::LowerHalf(d256, all), hn::UpperHalf(d256, all));
    const auto block = hn::Min(hn::LowerHalf(d128, half), hn::UpperHalf(d128, half));
#elif HWY_TARGET == HWY_AVX2
    const auto block = hn::Min(hn::LowerHalf(d128, all), hn::UpperHalf(d128, all));
#else
    const auto block = all;
#endif
    const hn::FixedTag<std::uint32_t, 4> b32;
    const auto two = hn::Min(block, hn::BitCast(d128, hn::ShiftRight<16>(hn::BitCast(b32, block))));
    const auto one = hn::Min(two, hn::BitCast(d128, hn::ShiftRight<8>(hn::BitCast(b32, two))));
    HWY_ALIGN std::uint32_t lanes[4];
    hn::Store(hn::BitCast(b32, one), b32, lanes);
    for (int k = 0; k < 4; ++k) out[k] = static_cast<std::uint8_t>(lanes[k]);
    return;
  } else
#endif
  {
    out[0] = hn::GetLane(hn::MinOfLanes(d, a));
    out[1] = hn::GetLane(hn::MinOfLanes(d, b));
    out[2] = hn::GetLane(hn::MinOfLanes(d, c));
    out[3] = hn::GetLane(hn::MinOfLanes(d, e));
  }
}

void PrepareRightRow(const std::uint8_t* right, const CostRow& row, std::uint8_t* prepared) {
  const std::size_t stride = row.right_stride;
  // place p holds column p + offset
  const int from = std::clamp(row.offset, 0, row.width),
            to = std::clamp(row.offset + row.width + row.lanes + kLaneMultiple, from, row.width);
  for (int k = 0; k < row.bytes; ++k) {
    const std::uint8_t* plane = right + static_cast<std::size_t>(k) * row.width;
#if GRANARY_NIBBLES
    const hn::ScalableTag<std::uint8_t> d8;
    std::uint8_t* low = prepared + 2 * k * stride + (from - row.offset);
    std::uint8_t* high = low + stride;
    const int lanes = static_cast<int>(hn::Lanes(d8));
    int x = from;
    for (; x + lanes <= to; x += lanes, low += lanes, high += lanes) {
      const auto byte = hn::LoadU(d8, plane + x);
      hn::StoreU(hn::And(byte, hn::Set(d8, 15)), d8, low);
      hn::StoreU(hn::ShiftRight<4>(byte), d8, high);
    }
    for (; x < to; ++x) {
      *low++ = plane[x] & 15;
      *high++ = plane[x] >> 4;
    }
#else
    if (to > from) std::memcpy(prepared + k * stride + (from - row.offset), plane + from, to - from);
#endif
  }
}

// kBytes 0: as many as the row says.
template <int kBytes>
void CostsOfBytes(const CostRow& row, int x, int step, int count, int first_lane, std::uint8_t* HWY_RESTRICT cost) {
  const int bytes = kBytes > 0 ? kBytes : row.bytes;
  const hn::ScalableTag<std::uint8_t> d8;
  using V = hn::Vec<decltype(d8)>;
  const int lanes = static_cast<int>(hn::Lanes(d8));
#if GRANARY_NIBBLES
  HWY_ALIGN static constexpr std::uint8_t kOnes[16] = {0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4};
  const auto ones = hn::LoadDup128(d8, kOnes);
#endif
  for (int i = 0; i < count; ++i, x += step, cost += row.stride) {
    V left[16];
    for (int k = 0; k < bytes; ++k) {
      const std::uint8_t byte = row.left[static_cast<std::size_t>(k) * row.width + x];
#if GRANARY_NIBBLES
      left[2 * k] = hn::Set(d8, byte & 15);
      left[2 * k + 1] = hn::Set(d8, byte >> 4);
#else
      left[k] = hn::Set(d8, byte);
#endif
    }
    const auto distance = [&](const std::uint8_t* right) {
      auto sum = hn::Zero(d8);
      for (int k = 0; k < bytes; ++k) {
#if GRANARY_NIBBLES
        const std::uint8_t* low = right + 2 * k * row.right_stride;
        sum = hn::Add(sum, hn::TableLookupBytes(ones, hn::Xor(left[2 * k], hn::LoadU(d8, low))));
        sum = hn::Add(sum, hn::TableLookupBytes(ones, hn::Xor(left[2 * k + 1], hn::LoadU(d8, low + row.right_stride))));
#else
        sum = hn::Add(sum, hn::PopulationCount(hn::Xor(left[k], hn::LoadU(d8, right + k * row.right_stride))));
#endif
      }
      return sum;
    };
    const std::uint8_t* right = row.right + x + first_lane;
    for (int e = 0; e < row.stride; e += lanes) hn::Store(distance(right + e), d8, cost + e);
    // right columns outside the picture
    const int column = x + first_lane + row.offset, slots = std::min(row.stride, row.lanes - first_lane);
    const int first = std::clamp(-column, 0, slots), last = std::clamp(row.width - column, first, slots);
    if (first > 0) std::memset(cost, row.outside, first);
    if (last < slots) std::memset(cost + last, row.outside, slots - last);
    if (slots < row.stride) std::memset(cost + slots, 255, row.stride - slots);
  }
}

void ComputeCostRun(const CostRow& row, int x, int step, int count, int first_lane, std::uint8_t* cost) {
  switch (row.bytes) {
    case 8:
      return CostsOfBytes<8>(row, x, step, count, first_lane, cost);  // 9×7
    case 3:
      return CostsOfBytes<3>(row, x, step, count, first_lane, cost);  // 5×5
    default:
      return CostsOfBytes<0>(row, x, step, count, first_lane, cost);
  }
}

// One path at one pixel: what it was at the pixel before, on its way to what it is here.
template <class D>
struct PathState {
  hn::Vec<D> before, here, jump, base, low;
  hn::TFromD<D>* slot;
};

template <class D>
HWY_INLINE PathState<D> BeginPath(D d, hn::TFromD<D>* slot, const hn::TFromD<D>* least, const hn::TFromD<D>* p2) {
  const auto all_ones = hn::Set(d, std::numeric_limits<hn::TFromD<D>>::max());
  const auto base = hn::Set(d, *least);
  return {all_ones, hn::Load(d, slot), hn::Add(base, hn::Set(d, *p2)), base, all_ones, slot};
}

// L − C of one vector of disparities; the slot's old values move on by one vector.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V StepPath(D d, PathState<D>& path, int e, V after, V cost, V p1) {
  const auto sides = hn::Min(FromLaneBefore(d, path.before, path.here), FromLaneAfter(d, path.here, after));
  const auto best = hn::Min(hn::Min(path.here, path.jump), hn::SaturatedAdd(sides, p1));
  const auto excess = hn::Sub(best, path.base);
  const auto value = hn::SaturatedAdd(excess, cost);
  path.low = hn::Min(path.low, value);
  hn::Store(value, d, path.slot + e);
  path.before = path.here;
  path.here = after;
  return excess;
}

// All paths at pixel i of a run. kVectors 0: as many as the stride says.
template <class T, bool kSums, int kVectors>
HWY_INLINE void StepPixel(const PathRun<T>& run, int i) {
  const hn::ScalableTag<T> d;
  using D = decltype(d);
  using V = hn::Vec<D>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int stride = kVectors > 0 ? kVectors * lanes : run.stride;
  const std::size_t first = static_cast<std::size_t>(i) * run.stride;
  const V p1 = hn::Set(d, run.p1), all_ones = hn::Set(d, std::numeric_limits<T>::max());
  const std::uint8_t* cost = run.cost + first;
  const auto load_cost = [&](int e) HWY_ATTR {
    if constexpr (sizeof(T) == 1) {
      return hn::Load(d, cost + e);
    } else {
      return hn::Or(hn::PromoteTo(d, hn::Load(hn::Rebind<std::uint8_t, D>(), cost + e)), hn::Load(d, run.padding + e));
    }
  };
  auto a = BeginPath(d, run.paths[0] + first, run.least[0] + i, run.p2[0] + i);
  auto b = BeginPath(d, run.paths[1] + first, run.least[1] + i, run.p2[1] + i);
  auto c = BeginPath(d, run.paths[2] + first, run.least[2] + i, run.p2[2] + i);
  T minima[4];
  int e = 0;
  if constexpr (kSums) {
    T* sums = run.sums + i * run.sums_step;
    auto r = BeginPath(d, run.row_path, run.row_least, run.p2[3] + i);
    const auto step = [&](V a_after, V b_after, V c_after, V r_after) HWY_ATTR __attribute__((always_inline)) {
      const V here = load_cost(e);
      const V ra = hn::Add(StepPath(d, r, e, r_after, here, p1), StepPath(d, a, e, a_after, here, p1));
      const V bc = hn::Add(StepPath(d, b, e, b_after, here, p1), StepPath(d, c, e, c_after, here, p1));
      hn::Store(hn::Add(ra, bc), d, sums + e);
    };
#pragma GCC unroll 4
    for (; e + lanes < stride; e += lanes) {
      const int n = e + lanes;
      step(hn::Load(d, a.slot + n), hn::Load(d, b.slot + n), hn::Load(d, c.slot + n), hn::Load(d, r.slot + n));
    }
    step(all_ones, all_ones, all_ones, all_ones);
    Minima(d, a.low, b.low, c.low, r.low, minima);
    *run.row_least = minima[3];
  } else {
    const auto step = [&](V a_after, V b_after, V c_after) HWY_ATTR __attribute__((always_inline)) {
      const V here = load_cost(e);
      StepPath(d, a, e, a_after, here, p1);
      StepPath(d, b, e, b_after, here, p1);
      StepPath(d, c, e, c_after, here, p1);
    };
    for (; e + lanes < stride; e += lanes) {
      const int n = e + lanes;
      step(hn::Load(d, a.slot + n), hn::Load(d, b.slot + n), hn::Load(d, c.slot + n));
    }
    step(all_ones, all_ones, all_ones);
    Minima(d, a.low, b.low, c.low, c.low, minima);
  }
  for (int k = 0; k < 3; ++k) run.least[k][i] = minima[k];
}

// The two runs are of different rows, the second a segment behind the first: what waits in one is done in the other.
template <class T, bool kSums, int kVectors>
void StepPathRuns(const PathRun<T>& first, const PathRun<T>* second) {
  int i = 0;
  if (second != nullptr) {
    for (; i < std::min(first.count, second->count); ++i) {
      StepPixel<T, kSums, kVectors>(first, i);
      StepPixel<T, kSums, kVectors>(*second, i);
    }
    for (int rest = i; rest < second->count; ++rest) StepPixel<T, kSums, kVectors>(*second, rest);
  }
  for (; i < first.count; ++i) StepPixel<T, kSums, kVectors>(first, i);
}

template <class T>
void StepPathsOf(const PathRun<T>& first, const PathRun<T>* second) {
  if (first.sums == nullptr) return StepPathRuns<T, false, 0>(first, second);
  switch (first.stride / static_cast<int>(hn::Lanes(hn::ScalableTag<T>()))) {
    case 1:
      return StepPathRuns<T, true, 1>(first, second);
    case 2:
      return StepPathRuns<T, true, 2>(first, second);
    case 4:
      return StepPathRuns<T, true, 4>(first, second);
    default:
      return StepPathRuns<T, true, 0>(first, second);
  }
}

void StepPaths8(const PathRun<std::uint8_t>& first, const PathRun<std::uint8_t>* second) { StepPathsOf(first, second); }
void StepPaths16(const PathRun<std::uint16_t>& first, const PathRun<std::uint16_t>* second) {
  StepPathsOf(first, second);
}

}  // namespace HWY_NAMESPACE
}  // namespace granary
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace granary {

HWY_EXPORT(PrepareRightRow);
HWY_EXPORT(ComputeCostRun);
HWY_EXPORT(StepPaths8);
HWY_EXPORT(StepPaths16);

void ChooseInstructionSet() {
  static const bool chosen = (hwy::GetChosenTarget().Update(hwy::SupportedTargets()), true);
  static_cast<void>(chosen);
}

std::size_t PreparedPlaneStride(int width, int lanes) {
  return (static_cast<std::size_t>(width) + lanes + 2 * kLaneMultiple - 1) / kLaneMultiple * kLaneMultiple +
         kLaneMultiple;
}

std::size_t PreparedBytes(int width, int lanes, int bytes) {
  return 2 * static_cast<std::size_t>(bytes) * PreparedPlaneStride(width, lanes);  // nibbles, where they are wanted
}

void PrepareRight(const std::uint8_t* right, const CostRow& row, std::uint8_t* prepared) {
  HWY_DYNAMIC_DISPATCH(PrepareRightRow)(right, row, prepared);
}
void ComputeCosts(const CostRow& row, int x, int step, int count, int first_lane, std::uint8_t* cost) {
  HWY_DYNAMIC_DISPATCH(ComputeCostRun)(row, x, step, count, first_lane, cost);
}
void StepPaths(const PathRun<std::uint8_t>& first, const PathRun<std::uint8_t>* second) {
  HWY_DYNAMIC_DISPATCH(StepPaths8)(first, second);
}
void StepPaths(const PathRun<std::uint16_t>& first, const PathRun<std::uint16_t>* second) {
  HWY_DYNAMIC_DISPATCH(StepPaths16)(first, second);
}

}  // namespace granary
#endif  // HWY_ONCE
