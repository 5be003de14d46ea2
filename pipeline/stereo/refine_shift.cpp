// The right picture is read through a quintic B-spline: a cubic through the pixels moves dots 2 px wide by up to
// 0.005 px at quarter disparities, Catmull–Rom by 0.013 px. The gradient comes from the left picture alone: noise that
// the interpolation has smoothed goes hand in hand with its own derivative and would pull towards half disparities.
#include "pipeline/stereo/refine_shift.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "pipeline/stereo/refine_rows.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "pipeline/stereo/refine_shift.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace granary {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<float, kRefineLanes>;
using V = hn::Vec<D>;

constexpr float kFinite = 1e30f;
constexpr float kStep_px = 1.0f;  // between neighbours: steeper surfaces are not seen by both cameras in any detail

HWY_INLINE V Times(float a, V b) { return hn::Mul(hn::Set(D(), a), b); }

void FilterRowImpl(const float* grey, const float* filter, int reach, int width, float* coefficients) {
  const D d;
  for (int x = 0; x < width; x += static_cast<int>(hn::Lanes(d))) {
    auto sum = Times(filter[0], hn::LoadU(d, grey + x));
    for (int i = 1; i <= reach; ++i) {
      sum = hn::Add(sum, Times(filter[i], hn::Add(hn::LoadU(d, grey + x - i), hn::LoadU(d, grey + x + i))));
    }
    hn::StoreU(sum, d, coefficients + x);
  }
}

// 120 times the outer pieces of the spline: at distance 3 − t, and at distance 2 − t (or 1 + (1 − t)).
HWY_INLINE V Tail(V t) {
  const auto square = hn::Mul(t, t);
  return hn::Mul(hn::Mul(square, square), t);
}
HWY_INLINE V Shoulder(V t) {
  const D d;
  const auto square = hn::Mul(t, t);
  const auto inner = hn::Sub(hn::Add(hn::Add(hn::Set(d, 10.0f), Times(10.0f, t)), Times(5.0f, square)),
                             Times(5.0f, hn::Mul(square, t)));
  return hn::Add(hn::Add(hn::Set(d, 1.0f), Times(5.0f, t)), hn::Mul(square, inner));
}
// 120 times the middle piece, at distance t.
HWY_INLINE V Crown(V t) {
  const D d;
  const auto square = hn::Mul(t, t);
  const auto inner = hn::Sub(hn::Set(d, 60.0f), hn::Mul(square, hn::Sub(hn::Set(d, 30.0f), Times(10.0f, t))));
  return hn::Sub(hn::Set(d, 66.0f), hn::Mul(square, inner));
}

void WarpRowImpl(const float* left, const float* left_counts, const float* coefficients, const float* right_counts,
                 const float* start_px, int row_width, int width, const MatchedRow& out) {
  const D d;
  const hn::RebindToSigned<D> di;
  const auto one = hn::Set(d, 1.0f), finite = hn::Set(d, kFinite);
  const auto least = hn::Set(d, 2.0f), most = hn::Set(d, static_cast<float>(row_width - 4));
  for (int x = 0; x < width; x += static_cast<int>(hn::Lanes(d))) {
    const auto start = hn::LoadU(d, start_px + x);
    const auto given = hn::Lt(hn::Abs(start), finite);
    const auto whole = hn::Floor(hn::IfThenElseZero(given, start));
    const auto down = hn::Sub(start, whole);  // exact, unlike the fraction of x − disparity
    const auto column = hn::Sub(hn::Iota(d, static_cast<float>(x - 1)), whole);
    const auto inside = hn::And(given, hn::And(hn::Ge(column, least), hn::Le(column, most)));
    const auto i = hn::ConvertTo(di, hn::IfThenElse(inside, column, least));
    const auto t = hn::Sub(one, hn::IfThenElseZero(inside, down));
    const auto s = hn::Sub(one, t);
    const auto tap = [&](int offset) { return hn::GatherIndex(d, coefficients + offset, i); };
    const auto outer = hn::Add(hn::Mul(Tail(s), tap(-2)), hn::Mul(Tail(t), tap(3)));
    const auto shoulder = hn::Add(hn::Mul(Shoulder(s), tap(-1)), hn::Mul(Shoulder(t), tap(2)));
    const auto crown = hn::Add(hn::Mul(Crown(t), tap(0)), hn::Mul(Crown(s), tap(1)));
    const auto r = Times(1.0f / 120, hn::Add(outer, hn::Add(shoulder, crown)));

    const auto l = hn::LoadU(d, left + x);
    const auto near = hn::Sub(hn::LoadU(d, left + x + 1), hn::LoadU(d, left + x - 1));
    const auto far = hn::Sub(hn::LoadU(d, left + x + 2), hn::LoadU(d, left + x - 2));
    const auto g = Times(1.0f / 12, hn::Sub(Times(8.0f, near), far));
    const auto sound = hn::And(hn::Lt(hn::Add(hn::Abs(l), hn::Abs(g)), finite), hn::Lt(hn::Abs(r), finite));
    // The gradient and, roughly, the spline see two pixels to either side: they must lie on the same surface.
    auto widest = hn::Zero(d);
    for (int o = -2; o < 2; ++o) {
      const auto step = hn::Abs(hn::Sub(hn::LoadU(d, start_px + x + o + 1), hn::LoadU(d, start_px + x + o)));
      widest = hn::IfThenElse(hn::Lt(step, hn::Set(d, kStep_px)), widest, one);
    }
    const auto smooth = hn::Eq(widest, hn::Zero(d));
    auto counts = hn::And(hn::And(inside, smooth), hn::And(sound, hn::Gt(hn::LoadU(d, left_counts + x), hn::Zero(d))));
    if (right_counts != nullptr) counts = hn::And(counts, hn::Gt(hn::GatherIndex(d, right_counts, i), hn::Zero(d)));
    hn::Store(hn::IfThenElseZero(counts, l), d, out.left + x);
    hn::Store(hn::IfThenElseZero(counts, g), d, out.gradient + x);
    hn::Store(hn::IfThenElseZero(counts, r), d, out.right + x);
    hn::Store(hn::IfThenElseZero(counts, one), d, out.counts + x);
  }
}

void SlideMatchColumnsRow(const MatchedRow& enters, const MatchedRow& leaves, int width,
                          float* const sums[kMatchSums]) {
  const D d;
  for (int x = 0; x < width; x += static_cast<int>(hn::Lanes(d))) {
    const auto n1 = hn::Load(d, enters.counts + x), n0 = hn::Load(d, leaves.counts + x);
    const auto l1 = hn::Load(d, enters.left + x), l0 = hn::Load(d, leaves.left + x);
    const auto r1 = hn::Load(d, enters.right + x), r0 = hn::Load(d, leaves.right + x);
    const auto g1 = hn::Load(d, enters.gradient + x), g0 = hn::Load(d, leaves.gradient + x);
    const auto add = [&](int c, V more, V less) HWY_ATTR {
      hn::Store(hn::Add(hn::Load(d, sums[c] + x), hn::Sub(more, less)), d, sums[c] + x);
    };
    add(0, n1, n0);
    add(1, l1, l0);
    add(2, r1, r0);
    add(3, g1, g0);
    add(4, hn::Mul(l1, l1), hn::Mul(l0, l0));
    add(5, hn::Mul(r1, r1), hn::Mul(r0, r0));
    add(6, hn::Mul(g1, g1), hn::Mul(g0, g0));
    add(7, hn::Mul(l1, r1), hn::Mul(l0, r0));
    add(8, hn::Mul(l1, g1), hn::Mul(l0, g0));
    add(9, hn::Mul(r1, g1), hn::Mul(r0, g0));
  }
}

void SumQuadsRow(float* const columns[kMatchSums], int width, float* const quads[kMatchSums]) {
  const D d;
  for (int c = 0; c < kMatchSums; ++c) {
    const float* in = columns[c];
    float* out = quads[c];
    for (int x = -kRefineLanes; x < width + kRefineLanes; x += static_cast<int>(hn::Lanes(d))) {
      const auto even = hn::Add(hn::Load(d, in + x), hn::LoadU(d, in + x + 1));
      hn::Store(hn::Add(even, hn::Add(hn::LoadU(d, in + x + 2), hn::LoadU(d, in + x + 3))), d, out + x);
    }
  }
}

void SolveRowImpl(float* const columns[kMatchSums], float* const quads[kMatchSums], const MatchedRow& middle,
                  float gain_scale, int radius, int width, const ShiftRow& shift, float* scores) {
  const D d;
  const float side = static_cast<float>(2 * radius + 1);
  const auto least_n = hn::Set(d, std::max(0.2f * side * side, 5.0f)), one = hn::Set(d, 1.0f), zero = hn::Zero(d);
  const auto nan = hn::Set(d, std::numeric_limits<float>::quiet_NaN());
  const auto least_gain = hn::Set(d, 0.2f * gain_scale), most_gain = hn::Set(d, 5 * gain_scale);
  for (int x = 0; x < width; x += static_cast<int>(hn::Lanes(d))) {
    // As many single columns as quads do not cover, one or three, then the quads.
    const auto sum = [&](int c) HWY_ATTR {
      auto total = hn::LoadU(d, columns[c] + x - radius);
      int at = 1 - radius;
      for (; (radius + 1 - at) % 4 != 0; ++at) total = hn::Add(total, hn::LoadU(d, columns[c] + x + at));
      for (; at <= radius; at += 4) total = hn::Add(total, hn::LoadU(d, quads[c] + x + at));
      return total;
    };
    const auto n = sum(0);
    const auto share = hn::Div(one, hn::Max(n, one));
    const auto ml = hn::Mul(sum(1), share), mr = hn::Mul(sum(2), share);
    const auto mg = hn::Mul(sum(3), share);
    const auto covariance = [&](int c, V a, V b) HWY_ATTR { return hn::Sub(hn::Mul(sum(c), share), hn::Mul(a, b)); };
    const auto ll = covariance(4, ml, ml), rr = covariance(5, mr, mr), gg = covariance(6, mg, mg);
    const auto lr = covariance(7, ml, mr), lg = covariance(8, ml, mg), rg = covariance(9, mr, mg);
    const auto det = hn::Sub(hn::Mul(rr, gg), hn::Mul(rg, rg));
    const auto textured =
        hn::And(hn::And(hn::Gt(rr, zero), hn::Gt(gg, zero)), hn::Gt(det, Times(1e-4f, hn::Mul(rr, gg))));
    const auto safe_det = hn::IfThenElse(textured, det, one);
    const auto gain = hn::Div(hn::Sub(hn::Mul(lr, gg), hn::Mul(lg, rg)), safe_det);
    const auto slope = hn::Div(hn::Sub(hn::Mul(lg, rr), hn::Mul(lr, rg)), safe_det);  // −δ
    const auto residual = hn::Max(zero, hn::Sub(ll, hn::Add(hn::Mul(gain, lr), hn::Mul(slope, lg))));
    const auto solved =
        hn::And(hn::And(textured, hn::Ge(n, least_n)), hn::And(hn::Ge(gain, least_gain), hn::Le(gain, most_gain)));
    // Noise makes up part of the gradient's square: 0.9 of the left picture's variance, which is half the residual's.
    const auto true_gg = hn::Max(hn::Sub(gg, Times(0.45f, residual)), Times(0.3f, gg));
    const auto noise_share = hn::Div(gg, true_gg);
    const auto degrees = hn::Max(hn::Sub(n, hn::Set(d, 3.0f)), one);
    const auto variance = hn::Div(hn::Mul(residual, rr), hn::Mul(degrees, safe_det));
    const auto deviation = hn::Mul(hn::Sqrt(hn::IfThenElseZero(solved, variance)), noise_share);
    hn::Store(hn::IfThenElse(solved, hn::Neg(slope), nan), d, shift.delta_px + x);
    // Less than half of the contrast explained: not a match.
    const auto agrees = hn::And(solved, hn::Lt(residual, Times(0.5f, ll)));
    hn::Store(hn::IfThenElse(agrees, deviation, nan), d, shift.deviation_px + x);
    if (scores == nullptr) continue;
    const auto counts = hn::And(agrees, hn::Gt(hn::Load(d, middle.counts + x), zero));
    const auto l = hn::Sub(hn::Load(d, middle.left + x), ml), r = hn::Sub(hn::Load(d, middle.right + x), mr);
    const auto g = hn::Sub(hn::Load(d, middle.gradient + x), mg);
    const auto error = hn::Sub(l, hn::Add(hn::Mul(gain, r), hn::Mul(slope, g)));
    const auto weight = hn::Sub(g, hn::Mul(hn::Div(rg, hn::IfThenElse(counts, rr, one)), r));
    const auto size = hn::Sqrt(hn::Div(hn::Mul(residual, det), hn::IfThenElse(counts, rr, one)));
    const auto big = hn::And(counts, hn::Gt(size, zero));
    hn::Store(hn::IfThenElseZero(big, hn::Div(hn::Mul(error, weight), hn::IfThenElse(big, size, one))), d, scores + x);
  }
}

void MoveRowImpl(const float* start_px, const float* delta_px, int width, float* disparity_px) {
  const D d;
  const auto one = hn::Set(d, 1.0f);
  for (int x = 0; x < width; x += static_cast<int>(hn::Lanes(d))) {
    const auto start = hn::LoadU(d, start_px + x), delta = hn::LoadU(d, delta_px + x);
    const auto step = hn::IfThenElseZero(hn::Eq(delta, delta), hn::Max(hn::Neg(one), hn::Min(one, delta)));
    const auto moved = hn::Add(start, step);
    hn::StoreU(hn::IfThenElse(hn::Eq(start, start), moved, hn::LoadU(d, disparity_px + x)), d, disparity_px + x);
  }
}

void FinishRowImpl(const float* before_px, const float* start_px, const ShiftRow& shift, const RefineLimits& limits,
                   int width, float* disparity_px, float* deviation_px) {
  const D d;
  const auto max_shift = hn::Set(d, limits.max_shift_px), max_delta = hn::Set(d, limits.max_delta_px);
  const auto unrefined = hn::Set(d, limits.unrefined_deviation_px);
  const auto nan = hn::Set(d, std::numeric_limits<float>::quiet_NaN()), finite = hn::Set(d, kFinite);
  for (int x = 0; x < width; x += static_cast<int>(hn::Lanes(d))) {
    const auto before = hn::LoadU(d, before_px + x), delta = hn::LoadU(d, shift.delta_px + x);
    const auto deviation = hn::LoadU(d, shift.deviation_px + x);
    const auto after = hn::Add(hn::LoadU(d, start_px + x), delta);
    const auto believed =
        hn::And(hn::Lt(hn::Abs(delta), max_delta),
                hn::And(hn::Le(hn::Abs(hn::Sub(after, before)), max_shift), hn::Lt(deviation, unrefined)));
    hn::StoreU(hn::IfThenElse(believed, after, before), d, disparity_px + x);
    const auto kept = hn::IfThenElse(hn::Lt(hn::Abs(before), finite), unrefined, nan);
    hn::StoreU(hn::IfThenElse(believed, deviation, kept), d, deviation_px + x);
  }
}

void AddScoreProductsRow(const float* scores, const float* scores_above, int width, float* const products[4]) {
  const D d;
  for (int x = 0; x < width; x += static_cast<int>(hn::Lanes(d))) {
    const auto q = hn::LoadU(d, scores + x);
    const auto add = [&](int c, V other) HWY_ATTR {
      hn::Store(hn::Add(hn::Load(d, products[c] + x), hn::Mul(q, other)), d, products[c] + x);
    };
    add(0, q);
    add(1, hn::LoadU(d, scores + x + 1));
    add(2, hn::LoadU(d, scores + x + 2));
    add(3, hn::LoadU(d, scores_above + x));
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace granary
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace granary {

HWY_EXPORT(FilterRowImpl);
HWY_EXPORT(WarpRowImpl);
HWY_EXPORT(SlideMatchColumnsRow);
HWY_EXPORT(SumQuadsRow);
HWY_EXPORT(SolveRowImpl);
HWY_EXPORT(MoveRowImpl);
HWY_EXPORT(FinishRowImpl);
HWY_EXPORT(AddScoreProductsRow);

std::vector<float> SplineFilter() {
  // The spline's values 1, 26, 66, 26, 1 (over 120) have the zeros z and 1/z for these two z: the inverse is the two
  // geometric decays one after the other. Cut where 0.43^12 = 4e-5 of the contrast is left, and made to sum to 1.
  constexpr int kReach = 12, kLong = 60;
  const double inner = std::sqrt(17745.0 / 4), outer = std::sqrt(105.0 / 4);
  const double zeros[2] = {std::sqrt(67.5 - inner) + outer - 6.5, std::sqrt(67.5 + inner) - outer - 6.5};
  std::vector<double> weights(kReach + 1, 0.0);
  double total = 0;
  for (int i = 0; i <= kReach; ++i) {
    for (int j = -kLong; j <= kLong; ++j) {
      weights[i] += std::pow(zeros[0], std::abs(j)) * std::pow(zeros[1], std::abs(i - j));
    }
    total += (i == 0 ? 1 : 2) * weights[i];
  }
  std::vector<float> filter;
  for (const double weight : weights) filter.push_back(static_cast<float>(weight / total));
  return filter;
}

void FilterRow(const float* grey, const std::vector<float>& filter, int width, float* coefficients) {
  HWY_DYNAMIC_DISPATCH(FilterRowImpl)
  (grey, filter.data(), static_cast<int>(filter.size()) - 1, RefineWidth(width), coefficients);
}

void WarpRow(const float* left, const float* left_counts, const float* right_coefficients, const float* right_counts,
             const float* start_px, int width, const MatchedRow& out) {
  HWY_DYNAMIC_DISPATCH(WarpRowImpl)
  (left, left_counts, right_coefficients, right_counts, start_px, width, RefineWidth(width), out);
}

void SlideMatchColumns(const MatchedRow& enters, const MatchedRow& leaves, int width, float* const sums[kMatchSums]) {
  HWY_DYNAMIC_DISPATCH(SlideMatchColumnsRow)(enters, leaves, RefineWidth(width), sums);
}

void SumQuads(float* const columns[kMatchSums], int width, float* const quads[kMatchSums]) {
  HWY_DYNAMIC_DISPATCH(SumQuadsRow)(columns, RefineWidth(width), quads);
}

void SolveRow(float* const columns[kMatchSums], float* const quads[kMatchSums], const MatchedRow& middle,
              float gain_scale, int radius, int width, const ShiftRow& shift, float* scores) {
  HWY_DYNAMIC_DISPATCH(SolveRowImpl)(columns, quads, middle, gain_scale, radius, RefineWidth(width), shift, scores);
}

void MoveRow(const float* start_px, const float* delta_px, int width, float* disparity_px) {
  HWY_DYNAMIC_DISPATCH(MoveRowImpl)(start_px, delta_px, RefineWidth(width), disparity_px);
}

void FinishRow(const float* before_px, const float* start_px, const ShiftRow& shift, const RefineLimits& limits,
               int width, float* disparity_px, float* deviation_px) {
  HWY_DYNAMIC_DISPATCH(FinishRowImpl)
  (before_px, start_px, shift, limits, RefineWidth(width), disparity_px, deviation_px);
}

void AddScoreProducts(const float* scores, const float* scores_above, int width, float* const products[4]) {
  HWY_DYNAMIC_DISPATCH(AddScoreProductsRow)(scores, scores_above, RefineWidth(width), products);
}

}  // namespace granary
#endif  // HWY_ONCE
