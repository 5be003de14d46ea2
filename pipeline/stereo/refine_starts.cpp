// A window straddles a step when one beside it is much flatter; curvature and noise raise the variance of all alike, so
// that no single threshold tells a step from a heap's flank.
#include "pipeline/stereo/refine_starts.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "pipeline/stereo/refine_planes.h"

namespace granary {

namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

constexpr float kSmooth_px2 = 0.05f;     // not looked into: about the noise of a census disparity
constexpr float kRough_px2 = 0.6f;       // no surface at all
constexpr float kOwnWindowBonus = 0.5f;  // a window beside must have less than half the variance of the pixel's own,
constexpr float kFarWindowMalus = 2.0f;  // a far one than a quarter: curvature spoils what is extrapolated
constexpr float kReach_px = 1.5f;        // a pixel further from a plane is not on it

// Counted from here the disparities of a band are small, and so is the rounding of their squares.
float Reference(const cv::Mat& disparity, int width, int y0, int y1) {
  double sum = 0;
  int n = 0;
  for (int y = y0; y < y1; y += 8) {
    const float* row = disparity.ptr<float>(y);
    for (int x = 0; x < width; x += 8) {
      if (!std::isfinite(row[x])) continue;
      sum += row[x];
      ++n;
    }
  }
  return n == 0 ? 0.0f : static_cast<float>(std::round(sum / n));
}

struct Start {
  float value_px;
  std::uint8_t window;
};
// `planes[i]` is the row of planes that window i of a pixel lies in.
Start ChooseWindow(const std::array<PlaneRow, 17>& planes, const WindowOffsets& offsets, int x, int width,
                   float disparity_px) {
  Start best{kNan, kNoWindow};
  float least = kRough_px2;
  const float own_variance = planes[0].variance_px2[x];
  if (own_variance < kRough_px2 && std::abs(planes[0].value_px[x] - disparity_px) < kReach_px) {
    best = {planes[0].value_px[x], 0};
    least = kOwnWindowBonus * own_variance;
  }
  for (std::size_t i = 1; i < offsets.size(); ++i) {
    const WindowOffset& offset = offsets[i];
    const int at = x + offset.dx;
    if (at < 0 || at >= width) continue;
    const float score = planes[i].variance_px2[at] * (offset.far ? kFarWindowMalus : 1.0f);
    if (!(score < least)) continue;
    const float value = planes[i].value_px[at] - planes[i].slope_x[at] * static_cast<float>(offset.dx) -
                        planes[i].slope_y[at] * static_cast<float>(offset.dy);
    if (!(std::abs(value - disparity_px) < kReach_px)) continue;
    best = {value, static_cast<std::uint8_t>(i)};
    least = score;
  }
  return best;
}

}  // namespace

WindowOffsets MakeWindowOffsets(int radius) {
  WindowOffsets offsets{};
  std::size_t i = 1;
  for (const bool far : {false, true}) {
    const int step = far ? radius : (radius + 1) / 2;
    for (const int dy : {-step, 0, step}) {
      for (const int dx : {-step, 0, step}) {
        if (dx != 0 || dy != 0) offsets[i++] = {dx, dy, far};
      }
    }
  }
  return offsets;
}

StartBuffers::StartBuffers(int radius, int width)
    : sums_(6, width, 0),
      none_(1, width, kInfinity),
      value_(2 * radius + 1, width, 0),
      slope_x_(2 * radius + 1, width, 0),
      slope_y_(2 * radius + 1, width, 0),
      variance_(2 * radius + 1, width, kInfinity),
      contested_(static_cast<std::size_t>(RefineWidth(width)) + kRefineLanes) {}

void FindStarts(const cv::Mat& disparity_px, int width, int radius, int y0, int y1, StartBuffers& b, cv::Mat& start_px,
                cv::Mat& window) {
  const int height = disparity_px.rows;
  const WindowOffsets offsets = MakeWindowOffsets(radius);
  const float reference = Reference(disparity_px, width, y0, y1);
  b.sums_.Fill(0);
  const DisparityColumns columns{b.sums_.Row(0), b.sums_.Row(1), b.sums_.Row(2),
                                 b.sums_.Row(3), b.sums_.Row(4), b.sums_.Row(5)};
  const auto planes = [&](int y) {
    return PlaneRow{b.value_.Row(y), b.slope_x_.Row(y), b.slope_y_.Row(y), b.variance_.Row(y)};
  };
  const auto row = [&](int y) {
    return y < std::max(0, y0 - 2 * radius) || y >= height ? b.none_.Row(0) : disparity_px.ptr<float>(y);
  };
  for (int enters = y0 - 2 * radius; enters < y1 + 2 * radius; ++enters) {
    SlideDisparityColumns(row(enters), row(enters - 2 * radius - 1), radius, reference, width, columns);
    const int middle = enters - radius, y = middle - radius;
    if (middle < y0 - radius) continue;
    if (middle >= 0 && middle < height) {
      FitPlanes(columns, radius, reference, width, planes(middle));
    } else {
      std::fill_n(planes(middle).variance_px2, width, kInfinity);
    }
    if (y < y0) continue;
    const float* d = disparity_px.ptr<float>(y);
    float* s = start_px.ptr<float>(y);
    std::uint8_t* w = window.ptr<std::uint8_t>(y);
    std::fill_n(w, width, std::uint8_t{0});
    const int contested = TakeOwnPlanes(d, planes(y), kSmooth_px2, kReach_px, width, s, b.contested_.data());
    std::array<PlaneRow, 17> around;
    for (std::size_t i = 0; i < around.size(); ++i) around[i] = planes(y + offsets[i].dy);
    for (int i = 0; i < contested; ++i) {
      const int x = b.contested_[i];
      const Start chosen = ChooseWindow(around, offsets, x, width, d[x]);
      s[x] = chosen.value_px;
      w[x] = chosen.window;
    }
  }
}

}  // namespace granary
