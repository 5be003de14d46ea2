// Rows enter at the bottom of the windows, are warped once and leave at the top. Windows beside a pixel reach one half
// window over the band's ends, so that a band repeats a little of its neighbours' work and shares nothing with them.
#include "pipeline/stereo/refine_bands.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace granary {

namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// 1 where `before` pixels to the left and `after` to the right are all usable and inside the picture.
void SpreadUnusable(const cv::Mat& usable, int y, int width, int before, int after, float* counts) {
  std::fill_n(counts, width, 1.0f);
  std::fill_n(counts, std::min(before, width), 0.0f);
  std::fill(counts + std::max(0, width - after), counts + width, 0.0f);
  if (usable.empty()) return;
  const std::uint8_t* row = usable.ptr<std::uint8_t>(y);
  for (int x = 0; x < width; ++x) {
    if (row[x] == 0) std::fill(counts + std::max(0, x - after), counts + std::min(width, x + before + 1), 0.0f);
  }
}

MatchedRow Matched(ShiftBuffers& b, int y) {
  return {b.left.Row(y), b.gradient.Row(y), b.right.Row(y), b.counts.Row(y)};
}

void Warp(const RefinePictures& pictures, const cv::Mat& start_px, int y, ShiftBuffers& b) {
  const int width = pictures.left.cols, reach = static_cast<int>(pictures.filter.size()) - 1;
  float *left = b.left_grey.Row(0), *right = b.right_grey.Row(0);
  const float *l = pictures.left.ptr<float>(y), *r = pictures.right.ptr<float>(y);
  for (int x = 0; x < width; ++x) left[x] = l[x] - pictures.left_mean;
  for (int x = 0; x < width; ++x) right[x] = r[x] - pictures.right_mean;
  std::fill_n(right - reach, reach, right[0]);
  std::fill_n(right + width, reach, right[width - 1]);
  FilterRow(right, pictures.filter, width, b.coefficients.Row(0));
  SpreadUnusable(pictures.left_usable, y, width, 2, 2, b.usable.Row(0));
  const bool masked = !pictures.right_usable.empty();
  if (masked) SpreadUnusable(pictures.right_usable, y, width, 2, 3, b.usable.Row(1));
  std::copy_n(start_px.ptr<float>(y), width, b.start.Row(0));
  WarpRow(left, b.usable.Row(0), b.coefficients.Row(0), masked ? b.usable.Row(1) : nullptr, b.start.Row(0), width,
          Matched(b, y));
}

// Solves every window of a band and of the rows that windows beside its pixels lie in. `take(y)` runs for each row of
// the band when the shifts of all of those are in the buffers.
template <typename Take>
void SolveBand(const RefinePictures& pictures, const cv::Mat& start_px, int radius, int y0, int y1, bool scored,
               ShiftBuffers& b, Take take) {
  const int height = pictures.left.rows, width = pictures.left.cols;
  b.columns.Fill(0);
  b.scores.Fill(0);
  b.products.Fill(0);
  float *columns[kMatchSums], *quads[kMatchSums];
  for (int c = 0; c < kMatchSums; ++c) {
    columns[c] = b.columns.Row(c);
    quads[c] = b.quads.Row(c);
  }
  float* const products[4] = {b.products.Row(0), b.products.Row(1), b.products.Row(2), b.products.Row(3)};
  const MatchedRow none{b.none.Row(0), b.none.Row(0), b.none.Row(0), b.none.Row(0)};
  const auto inside = [&](int y) { return y >= std::max(0, y0 - 2 * radius) && y < height; };
  for (int enters = y0 - 2 * radius; enters < y1 + 2 * radius; ++enters) {
    const int leaves = enters - 2 * radius - 1, middle = enters - radius;
    if (inside(enters)) Warp(pictures, start_px, enters, b);
    SlideMatchColumns(inside(enters) ? Matched(b, enters) : none, inside(leaves) ? Matched(b, leaves) : none, width,
                      columns);
    if (middle < y0 - radius) continue;
    if (middle >= 0 && middle < height) {
      const bool score = scored && middle >= y0 && middle < y1;
      SumQuads(columns, width, quads);
      SolveRow(columns, quads, Matched(b, middle), pictures.gain_scale, radius, width,
               {b.delta.Row(middle), b.deviation.Row(middle)}, score ? b.scores.Row(middle) : nullptr);
      if (score) AddScoreProducts(b.scores.Row(middle), b.scores.Row(middle - 1), width, products);
    } else {
      std::fill_n(b.delta.Row(middle), width, kNan);
      std::fill_n(b.deviation.Row(middle), width, kNan);
    }
    if (middle - radius >= y0) take(middle - radius);
  }
}

// Calls `use(x)` for every pixel that has a window beside its own. Those are few: eight at a time are passed over.
template <typename Use>
void ForEachBeside(const std::uint8_t* window, int width, Use use) {
  for (int x = 0; x < width; x += 8) {
    std::uint64_t eight = 0;
    std::memcpy(&eight, window + x, std::min(8, width - x));
    if (eight == 0) continue;
    for (int i = x; i < std::min(x + 8, width); ++i) {
      if (window[i] != 0 && window[i] != kNoWindow) use(i);
    }
  }
}

}  // namespace

ShiftBuffers::ShiftBuffers(int radius, int width)
    : left(2 * radius + 2, width, 0),
      gradient(2 * radius + 2, width, 0),
      right(2 * radius + 2, width, 0),
      counts(2 * radius + 2, width, 0),
      none(1, width, 0),
      left_grey(1, width, 0),
      right_grey(1, width, 0),
      coefficients(1, width, 0),
      usable(2, width, 0),
      start(1, width, kNan),
      columns(kMatchSums, width, 0),
      quads(kMatchSums, width, 0),
      delta(2 * radius + 1, width, kNan),
      deviation(2 * radius + 1, width, kNan),
      shifted_delta(1, width, kNan),
      shifted_deviation(1, width, kNan),
      scores(2, width, 0),
      products(4, width, 0),
      finished(3, width, std::numeric_limits<float>::infinity()) {}

void MoveBand(const RefinePictures& pictures, const cv::Mat& start_px, const cv::Mat& window, int radius, int y0,
              int y1, ShiftBuffers& b, cv::Mat& disparity_px) {
  const int width = pictures.left.cols;
  const WindowOffsets offsets = MakeWindowOffsets(radius);
  SolveBand(pictures, start_px, radius, y0, y1, false, b, [&](int y) {
    const std::uint8_t* w = window.ptr<std::uint8_t>(y);
    float* delta = b.shifted_delta.Row(0);
    std::copy_n(b.delta.Row(y), RefineWidth(width), delta);
    ForEachBeside(w, width, [&](int x) { delta[x] = b.delta.Row(y + offsets[w[x]].dy)[x + offsets[w[x]].dx]; });
    MoveRow(start_px.ptr<float>(y), delta, width, disparity_px.ptr<float>(y));
  });
}

void FinishBand(const RefinePictures& pictures, const cv::Mat& start_px, const cv::Mat& window, int radius, int y0,
                int y1, const cv::Mat& before_px, const RefineLimits& limits, ShiftBuffers& b, cv::Mat& disparity_px,
                cv::Mat& deviation_px, double* score_products) {
  // A plane is less sure beside its window than in its middle, and the surface may bend or end there.
  constexpr float kBend_px = 0.1f;
  const int width = pictures.left.cols;
  const float spread = static_cast<float>(radius * (radius + 1)) / 3;
  const WindowOffsets offsets = MakeWindowOffsets(radius);
  SolveBand(pictures, start_px, radius, y0, y1, true, b, [&](int y) {
    const std::uint8_t* w = window.ptr<std::uint8_t>(y);
    float *delta = b.shifted_delta.Row(0), *deviation = b.shifted_deviation.Row(0);
    std::copy_n(b.delta.Row(y), RefineWidth(width), delta);
    std::copy_n(b.deviation.Row(y), RefineWidth(width), deviation);
    ForEachBeside(w, width, [&](int x) {
      const auto [dx, dy, far] = offsets[w[x]];
      const float there = b.deviation.Row(y + dy)[x + dx];
      delta[x] = b.delta.Row(y + dy)[x + dx];
      deviation[x] =
          std::sqrt(there * there * (1 + static_cast<float>(dx * dx + dy * dy) / spread) + kBend_px * kBend_px);
    });
    float *before = b.finished.Row(0), *d = b.finished.Row(1), *s = b.finished.Row(2);
    std::copy_n(before_px.ptr<float>(y), width, before);
    FinishRow(before, start_px.ptr<float>(y), {delta, deviation}, limits, width, d, s);
    std::copy_n(d, width, disparity_px.ptr<float>(y));
    std::copy_n(s, width, deviation_px.ptr<float>(y));
  });
  for (int c = 0; c < 4; ++c) {
    for (int x = 0; x < width; ++x) score_products[c] += b.products.Row(c)[x];
  }
}

}  // namespace granary
