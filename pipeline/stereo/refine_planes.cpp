// Running sums down the columns, then weighted sums along the row: a window costs its width, not its area, and no pixel
// waits for its neighbour. Slopes come from moments about the window's own middle, so that nothing large cancels.
#include "pipeline/stereo/refine_planes.h"

#include <limits>

#include "pipeline/stereo/refine_rows.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "pipeline/stereo/refine_planes.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace granary {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<float, kRefineLanes>;
using V = hn::Vec<D>;

constexpr float kFinite = 1e30f;

HWY_INLINE V Times(float a, V b) { return hn::Mul(hn::Set(D(), a), b); }

void SlideDisparityColumnsRow(const float* enters, const float* leaves, int radius, float reference_px, int width,
                              const DisparityColumns& c) {
  const D d;
  const auto one = hn::Set(d, 1.0f), reference = hn::Set(d, reference_px), finite = hn::Set(d, kFinite);
  const float in = static_cast<float>(radius), out = static_cast<float>(radius + 1);
  for (int x = 0; x < width; x += static_cast<int>(hn::Lanes(d))) {
    const auto new_d = hn::LoadU(d, enters + x), old_d = hn::LoadU(d, leaves + x);
    const auto is_new = hn::Lt(new_d, finite), is_old = hn::Lt(old_d, finite);
    const auto v1 = hn::IfThenElseZero(is_new, one), v0 = hn::IfThenElseZero(is_old, one);
    const auto d1 = hn::IfThenElseZero(is_new, hn::Sub(new_d, reference));
    const auto d0 = hn::IfThenElseZero(is_old, hn::Sub(old_d, reference));
    const auto n = hn::Load(d, c.n + x), k = hn::Load(d, c.k + x), kk = hn::Load(d, c.kk + x);
    const auto sum = hn::Load(d, c.d + x), kd = hn::Load(d, c.kd + x), dd = hn::Load(d, c.dd + x);
    // One row down every k is one less; the row that leaves then lies at −radius − 1.
    hn::Store(hn::Add(n, hn::Sub(v1, v0)), d, c.n + x);
    hn::Store(hn::Add(hn::Sub(k, n), hn::Add(Times(in, v1), Times(out, v0))), d, c.k + x);
    hn::Store(hn::Add(hn::Add(hn::Sub(kk, hn::Add(k, k)), n), hn::Sub(Times(in * in, v1), Times(out * out, v0))), d,
              c.kk + x);
    hn::Store(hn::Add(sum, hn::Sub(d1, d0)), d, c.d + x);
    hn::Store(hn::Add(hn::Sub(kd, sum), hn::Add(Times(in, d1), Times(out, d0))), d, c.kd + x);
    hn::Store(hn::Add(dd, hn::Sub(hn::Mul(d1, d1), hn::Mul(d0, d0))), d, c.dd + x);
  }
}

// Σ over the window and Σ of the columns' offset times the value.
HWY_INLINE void SumsAlong(const float* row, int radius, V& sum, V& moment) {
  const D d;
  sum = hn::LoadU(d, row);
  moment = hn::Zero(d);
  for (int i = 1; i <= radius; ++i) {
    const auto right = hn::LoadU(d, row + i), left = hn::LoadU(d, row - i);
    sum = hn::Add(sum, hn::Add(right, left));
    moment = hn::Add(moment, Times(static_cast<float>(i), hn::Sub(right, left)));
  }
}
HWY_INLINE V SumAlong(const float* row, int radius) {
  const D d;
  auto sum = hn::LoadU(d, row);
  for (int i = 1; i <= radius; ++i) sum = hn::Add(sum, hn::Add(hn::LoadU(d, row + i), hn::LoadU(d, row - i)));
  return sum;
}
HWY_INLINE V SecondMomentAlong(const float* row, int radius) {
  const D d;
  auto sum = hn::Zero(d);
  for (int i = 1; i <= radius; ++i) {
    sum = hn::Add(sum, Times(static_cast<float>(i * i), hn::Add(hn::LoadU(d, row + i), hn::LoadU(d, row - i))));
  }
  return sum;
}

void FitPlanesRow(const DisparityColumns& c, int radius, float reference_px, int width, const PlaneRow& planes) {
  const D d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const float side = static_cast<float>(2 * radius + 1);
  const float full = side * side, spread = static_cast<float>(radius * (radius + 1)) / 3;
  const auto least_n = hn::Set(d, 0.3f * full), least_spread = hn::Set(d, 0.2f * spread);
  const auto tall = hn::Set(d, side);
  const auto infinite = hn::Set(d, std::numeric_limits<float>::infinity());
  for (int x = 0; x < width; x += lanes) {
    auto complete = hn::Eq(tall, tall);
    for (int o = -radius; o < radius + lanes; o += lanes) {
      complete = hn::And(complete, hn::Eq(hn::LoadU(d, c.n + x + o), tall));
    }
    // The short cut gives the same numbers: counts and moments of counts are whole numbers, exact as floats.
    V n = hn::Set(d, full), sx = hn::Zero(d), sy = sx, sxy = sx, sxx = hn::Set(d, full * spread), syy = sxx;
    if (!hn::AllTrue(d, complete)) {
      SumsAlong(c.n + x, radius, n, sx);
      SumsAlong(c.k + x, radius, sy, sxy);
      sxx = SecondMomentAlong(c.n + x, radius);
      syy = SumAlong(c.kk + x, radius);
    }
    V sd, sxd;
    SumsAlong(c.d + x, radius, sd, sxd);
    const auto skd = SumAlong(c.kd + x, radius), sdd = SumAlong(c.dd + x, radius);
    const auto share = hn::Div(hn::Set(d, 1.0f), hn::Max(n, hn::Set(d, 1.0f)));
    const auto mx = hn::Mul(sx, share), my = hn::Mul(sy, share), md = hn::Mul(sd, share);
    const auto covariance = [&](V sum, V a, V b) { return hn::Sub(hn::Mul(sum, share), hn::Mul(a, b)); };
    const auto xx = covariance(sxx, mx, mx), yy = covariance(syy, my, my), xy = covariance(sxy, mx, my);
    const auto xd = covariance(sxd, mx, md), yd = covariance(skd, my, md), dd = covariance(sdd, md, md);
    const auto det = hn::Sub(hn::Mul(xx, yy), hn::Mul(xy, xy));
    const auto usable = hn::And(hn::And(hn::Ge(n, least_n), hn::Ge(xx, least_spread)),
                                hn::And(hn::Ge(yy, least_spread), hn::Gt(det, hn::Set(d, 0.01f))));
    const auto safe_det = hn::IfThenElse(usable, det, hn::Set(d, 1.0f));
    const auto a = hn::Div(hn::Sub(hn::Mul(xd, yy), hn::Mul(yd, xy)), safe_det);
    const auto b = hn::Div(hn::Sub(hn::Mul(yd, xx), hn::Mul(xd, xy)), safe_det);
    const auto variance = hn::Max(hn::Zero(d), hn::Sub(dd, hn::Add(hn::Mul(a, xd), hn::Mul(b, yd))));
    const auto at_pixel = hn::Sub(md, hn::Add(hn::Mul(a, mx), hn::Mul(b, my)));
    hn::Store(hn::Add(at_pixel, hn::Set(d, reference_px)), d, planes.value_px + x);
    hn::Store(a, d, planes.slope_x + x);
    hn::Store(b, d, planes.slope_y + x);
    hn::Store(hn::IfThenElse(usable, variance, infinite), d, planes.variance_px2 + x);
  }
}

int TakeOwnPlanesRow(const float* disparity_px, const PlaneRow& planes, float smooth_variance_px2, float reach_px,
                     int width, float* start_px, std::int32_t* contested) {
  const D d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto smooth = hn::Set(d, smooth_variance_px2), reach = hn::Set(d, reach_px), finite = hn::Set(d, kFinite);
  const auto nan = hn::Set(d, std::numeric_limits<float>::quiet_NaN());
  int count = 0;
  for (int x = 0; x < width; x += lanes) {
    const auto disparity = hn::LoadU(d, disparity_px + x), value = hn::Load(d, planes.value_px + x);
    const auto own = hn::And(hn::Lt(hn::Load(d, planes.variance_px2 + x), smooth),
                             hn::Lt(hn::Abs(hn::Sub(value, disparity)), reach));
    hn::StoreU(hn::IfThenElse(own, value, nan), d, start_px + x);
    const auto open = hn::AndNot(own, hn::Lt(disparity, finite));
    if (hn::AllFalse(d, open)) continue;
    const hn::RebindToSigned<D> di;
    count += static_cast<int>(hn::CompressStore(hn::Iota(di, x), hn::RebindMask(di, open), di, contested + count));
  }
  return count;
}

}  // namespace HWY_NAMESPACE
}  // namespace granary
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace granary {

HWY_EXPORT(SlideDisparityColumnsRow);
HWY_EXPORT(FitPlanesRow);
HWY_EXPORT(TakeOwnPlanesRow);

void SlideDisparityColumns(const float* enters, const float* leaves, int radius, float reference_px, int width,
                           const DisparityColumns& columns) {
  HWY_DYNAMIC_DISPATCH(SlideDisparityColumnsRow)(enters, leaves, radius, reference_px, RefineWidth(width), columns);
}

void FitPlanes(const DisparityColumns& columns, int radius, float reference_px, int width, const PlaneRow& planes) {
  HWY_DYNAMIC_DISPATCH(FitPlanesRow)(columns, radius, reference_px, RefineWidth(width), planes);
}

int TakeOwnPlanes(const float* disparity_px, const PlaneRow& planes, float smooth_variance_px2, float reach_px,
                  int width, float* start_px, std::int32_t* contested) {
  return HWY_DYNAMIC_DISPATCH(TakeOwnPlanesRow)(disparity_px, planes, smooth_variance_px2, reach_px, RefineWidth(width),
                                                start_px, contested);
}

}  // namespace granary
#endif  // HWY_ONCE
