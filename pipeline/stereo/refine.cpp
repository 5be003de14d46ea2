// Passes of two stages over bands of fixed height, whatever the threads: planes through the disparities give every
// pixel a start that follows its surface; grey values then say what the start lacks. All windows of a row are summed at
// once, so the cost of a pixel hardly depends on the window.
#include "pipeline/stereo/refine.h"

#include <sys/mman.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <tbb/parallel_for.h>
#include <opencv2/core.hpp>

#include "pipeline/stereo/refine_planes.h"
#include "pipeline/stereo/refine_rows.h"
#include "pipeline/stereo/refine_shift.h"

namespace granary {

namespace {

constexpr float kUnrefinedDeviation_px = 0.3f;  // census + SGM + equiangular, see docs/method.md
constexpr int kBandRows = 128;
constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

template <typename Body>
void ForEachBand(int height, Body body) {
  const int bands = (height + kBandRows - 1) / kBandRows;
  tbb::parallel_for(0, bands, [&](int band) { body(band * kBandRows, std::min(height, (band + 1) * kBandRows)); });
}

// Where the window that a pixel uses lies: its own (0), or one of two rings around it.
struct Offset {
  int dx, dy;
  bool far;
};
using Offsets = std::array<Offset, 17>;
Offsets WindowOffsets(int radius) {
  Offsets offsets{};
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
constexpr std::uint8_t kNoWindow = 255;

// The planes of the rows that windows beside a row can lie in.
class PlaneRows {
 public:
  PlaneRows(int radius, int width)
      : value_(2 * radius + 1, width, 0),
        x_(2 * radius + 1, width, 0),
        y_(2 * radius + 1, width, 0),
        variance_(2 * radius + 1, width, kInfinity) {}
  PlaneRow Row(int y) { return {value_.Row(y), x_.Row(y), y_.Row(y), variance_.Row(y)}; }

 private:
  RowRing value_, x_, y_, variance_;
};

// A window straddles a step when one beside it is much flatter; curvature and noise raise the variance of all alike.
constexpr float kSmooth_px2 = 0.05f;     // not looked into: the noise of a census disparity
constexpr float kRough_px2 = 0.6f;       // no surface at all
constexpr float kOwnWindowBonus = 0.5f;  // a window beside must have half the variance of the pixel's own,
constexpr float kFarWindowMalus = 2.0f;  // a far one a quarter: curvature spoils what is extrapolated
constexpr float kReach_px = 1.5f;        // a pixel further from a plane is not on it

struct Start {
  float value_px;
  std::uint8_t window;
};
Start ChooseWindow(PlaneRows& planes, const Offsets& offsets, int x, int y, int width, float disparity_px) {
  const PlaneRow own = planes.Row(y);
  Start best{kNan, kNoWindow};
  float least = kRough_px2;
  if (own.variance_px2[x] < kRough_px2 && std::abs(own.value_px[x] - disparity_px) < kReach_px) {
    best = {own.value_px[x], 0};
    least = kOwnWindowBonus * own.variance_px2[x];
  }
  for (std::size_t i = 1; i < offsets.size(); ++i) {
    const auto [dx, dy, far] = offsets[i];
    if (x + dx < 0 || x + dx >= width) continue;
    const PlaneRow row = planes.Row(y + dy);
    const float score = row.variance_px2[x + dx] * (far ? kFarWindowMalus : 1.0f);
    if (!(score < least)) continue;
    const float value = row.value_px[x + dx] - row.slope_x[x + dx] * static_cast<float>(dx) -
                        row.slope_y[x + dx] * static_cast<float>(dy);
    if (!(std::abs(value - disparity_px) < kReach_px)) continue;
    best = {value, static_cast<std::uint8_t>(i)};
    least = score;
  }
  return best;
}

// Counted from here the disparities of a band are small, and so is the rounding of their squares.
float Reference(const cv::Mat& disparity, int y0, int y1) {
  double sum = 0;
  int n = 0;
  for (int y = y0; y < y1; y += 8) {
    const float* row = disparity.ptr<float>(y);
    for (int x = 0; x < disparity.cols; x += 8) {
      if (!std::isfinite(row[x])) continue;
      sum += row[x];
      ++n;
    }
  }
  return n == 0 ? 0.0f : static_cast<float>(std::round(sum / n));
}

// Fills `start` with the plane's value at each pixel, NaN where it has no window, and `window` with which one it is.
void FindStarts(const cv::Mat& current, int width, int radius, cv::Mat& start, cv::Mat& window) {
  const int height = current.rows;
  const Offsets offsets = WindowOffsets(radius);
  ForEachBand(height, [&](int y0, int y1) {
    const float reference = Reference(current, y0, y1);
    RowRing sums(6, width, 0), none(1, width, kInfinity);
    const DisparityColumns columns{sums.Row(0), sums.Row(1), sums.Row(2), sums.Row(3), sums.Row(4), sums.Row(5)};
    PlaneRows planes(radius, width);
    std::vector<int> contested(static_cast<std::size_t>(RefineWidth(width)) + 1);
    const auto row = [&](int y) {
      return y < std::max(0, y0 - 2 * radius) || y >= height ? none.Row(0) : current.ptr<float>(y);
    };
    for (int enters = y0 - 2 * radius; enters < y1 + 2 * radius; ++enters) {
      SlideDisparityColumns(row(enters), row(enters - 2 * radius - 1), radius, reference, width, columns);
      const int middle = enters - radius;
      if (middle < y0 - radius) continue;
      if (middle >= 0 && middle < height) {
        FitPlanes(columns, radius, reference, width, planes.Row(middle));
      } else {
        std::fill_n(planes.Row(middle).variance_px2, width, kInfinity);
      }
      const int y = middle - radius;
      if (y < y0) continue;
      float* s = start.ptr<float>(y);
      const float* d = current.ptr<float>(y);
      std::uint8_t* w = window.ptr<std::uint8_t>(y);
      std::fill_n(w, width, std::uint8_t{0});
      const int count = TakeOwnPlanes(d, planes.Row(y), kSmooth_px2, kReach_px, width, s, contested.data());
      for (int i = 0; i < count; ++i) {
        const int x = contested[i];
        const Start chosen = ChooseWindow(planes, offsets, x, y, width, d[x]);
        s[x] = chosen.value_px;
        w[x] = chosen.window;
      }
    }
  });
}

// Mean and standard deviation of a picture, from every fourth row.
struct Contrast {
  float mean, deviation;
};
Contrast MeasureContrast(const cv::Mat& grey, const cv::Mat& usable) {
  double n = 0, sum = 0, squares = 0;
  for (int y = 0; y < grey.rows; y += 4) {
    const float* row = grey.ptr<float>(y);
    for (int x = 0; x < grey.cols; ++x) {
      if (!std::isfinite(row[x]) || (!usable.empty() && usable.at<std::uint8_t>(y, x) == 0)) continue;
      ++n;
      sum += row[x];
      squares += static_cast<double>(row[x]) * row[x];
    }
  }
  if (n == 0) return {0, 0};
  return {static_cast<float>(sum / n), static_cast<float>(std::sqrt(std::max(0.0, squares / n - sum / n * (sum / n))))};
}

// Both pictures, and what all bands read of them.
struct Pictures {
  const cv::Mat &left, &right, &left_usable, &right_usable;
  Contrast left_contrast, right_contrast;
  std::vector<float> filter = SplineFilter();
};

// 1 where `before` pixels to the left and `after` to the right are all usable and inside the picture.
void SpreadUnusable(const cv::Mat& usable, int y, int width, int before, int after, float* counts) {
  std::fill_n(counts, width, 1.0f);
  for (int x = 0; x < std::min(before, width); ++x) counts[x] = 0;
  for (int x = std::max(0, width - after); x < width; ++x) counts[x] = 0;
  if (usable.empty()) return;
  const std::uint8_t* row = usable.ptr<std::uint8_t>(y);
  for (int x = 0; x < width; ++x) {
    if (row[x] == 0) std::fill(counts + std::max(0, x - after), counts + std::min(width, x + before + 1), 0.0f);
  }
}

// Warps rows of a band and keeps as many as a window is high, and the one that just left.
class MatchedRows {
 public:
  MatchedRows(const Pictures& pictures, const cv::Mat& start, int radius, int width)
      : pictures_(pictures),
        start_(start),
        width_(width),
        left_(2 * radius + 2, width, 0),
        gradient_(2 * radius + 2, width, 0),
        right_(2 * radius + 2, width, 0),
        counts_(2 * radius + 2, width, 0),
        scratch_(5, width, 0),
        zero_(1, width, 0) {
    SpreadUnusable({}, 0, width, 2, 2, scratch_.Row(3));
  }

  MatchedRow Row(int y) { return {left_.Row(y), gradient_.Row(y), right_.Row(y), counts_.Row(y)}; }
  MatchedRow Nothing() { return {zero_.Row(0), zero_.Row(0), zero_.Row(0), zero_.Row(0)}; }

  void Warp(int y) {
    float *left = scratch_.Row(0), *right = scratch_.Row(1), *coefficients = scratch_.Row(2);
    const float *l = pictures_.left.ptr<float>(y), *r = pictures_.right.ptr<float>(y);
    const float left_mean = pictures_.left_contrast.mean, right_mean = pictures_.right_contrast.mean;
    for (int x = 0; x < width_; ++x) left[x] = l[x] - left_mean;
    for (int x = 0; x < width_; ++x) right[x] = r[x] - right_mean;
    const int reach = static_cast<int>(pictures_.filter.size()) - 1;
    std::fill_n(right - reach, reach, right[0]);
    std::fill_n(right + width_, reach, right[width_ - 1]);
    FilterRow(right, pictures_.filter, width_, coefficients);
    if (!pictures_.left_usable.empty()) SpreadUnusable(pictures_.left_usable, y, width_, 2, 2, scratch_.Row(3));
    if (!pictures_.right_usable.empty()) SpreadUnusable(pictures_.right_usable, y, width_, 2, 3, scratch_.Row(4));
    WarpRow(left, scratch_.Row(3), coefficients, pictures_.right_usable.empty() ? nullptr : scratch_.Row(4),
            start_.ptr<float>(y), width_, Row(y));
  }

 private:
  const Pictures& pictures_;
  const cv::Mat& start_;
  int width_;
  RowRing left_, gradient_, right_, counts_, scratch_, zero_;
};

// Solves every window of a band and of the rows that windows beside it can lie in. `take(y, shifts)` runs for each row
// of the band when all of those are known: `shifts(y)` is the row of shifts at y.
// @param products receives the sums of AddScoreProducts over the band, or nullptr
template <typename Take>
void SolveBand(const Pictures& pictures, const cv::Mat& start, int radius, int y0, int y1, double* products,
               Take take) {
  const int height = pictures.left.rows, width = pictures.left.cols;
  const float gain_scale =
      pictures.right_contrast.deviation > 0 ? pictures.left_contrast.deviation / pictures.right_contrast.deviation : 1;
  MatchedRows matched(pictures, start, radius, width);
  RowRing columns(kMatchSums, width, 0), windows(kMatchSums, width, 0), scratch(4, width, 0);
  RowRing delta(2 * radius + 1, width, kNan), deviation(2 * radius + 1, width, kNan);
  RowRing scores(2, width, 0), product_rows(4, width, 0);
  float *column[kMatchSums], *window[kMatchSums];
  for (int c = 0; c < kMatchSums; ++c) {
    column[c] = columns.Row(c);
    window[c] = windows.Row(c);
  }
  float* const part[4] = {scratch.Row(0), scratch.Row(1), scratch.Row(2), scratch.Row(3)};
  float* const product[4] = {product_rows.Row(0), product_rows.Row(1), product_rows.Row(2), product_rows.Row(3)};
  const auto shifts = [&](int y) { return ShiftRow{delta.Row(y), deviation.Row(y)}; };
  const auto entered = [&](int y) { return y >= std::max(0, y0 - 2 * radius) && y < height; };
  for (int enters = y0 - 2 * radius; enters < y1 + 2 * radius; ++enters) {
    const int leaves = enters - 2 * radius - 1;
    if (entered(enters)) matched.Warp(enters);
    if (entered(enters) || entered(leaves)) {
      SlideMatchColumns(entered(enters) ? matched.Row(enters) : matched.Nothing(),
                        entered(leaves) ? matched.Row(leaves) : matched.Nothing(), width, column);
    }
    const int middle = enters - radius;
    if (middle < y0 - radius) continue;
    if (middle >= 0 && middle < height) {
      for (int c = 0; c < kMatchSums; ++c) SumWindows(column[c], radius, width, part, window[c]);
      const bool scored = products != nullptr && middle >= y0 && middle < y1;
      SolveRow(window, matched.Row(middle), gain_scale, radius, width, shifts(middle),
               scored ? scores.Row(middle) : nullptr);
      if (scored) AddScoreProducts(scores.Row(middle), scores.Row(middle - 1), width, product);
    } else {
      std::fill_n(delta.Row(middle), width, kNan);
    }
    if (middle - radius >= y0) take(middle - radius, shifts);
  }
  if (products == nullptr) return;
  for (int c = 0; c < 4; ++c) {
    for (int x = 0; x < width; ++x) products[c] += product[c][x];
  }
}

// By how much neighbouring residuals that go together raise the deviation: the variance of a sum of correlated terms
// over that of independent ones, the correlation taken as the product of one along and one across the rows.
float NeighbourFactor(const std::vector<std::array<double, 4>>& bands) {
  std::array<double, 4> sum{};
  for (const auto& band : bands) {
    for (std::size_t c = 0; c < sum.size(); ++c) sum[c] += band[c];
  }
  if (!(sum[0] > 0)) return 1;
  const double along = 1 + 2 * (sum[1] + sum[2]) / sum[0], across = 1 + 2 * sum[3] / sum[0];
  return static_cast<float>(std::sqrt(std::clamp(along, 0.5, 5.0) * std::clamp(across, 0.5, 3.0)));
}

// An uninitialised Mat of floats whose pages the kernel is asked to make large: see large_pages.h.
cv::Mat LargeMat(int rows, int cols) {
  cv::Mat mat(rows, cols, CV_32FC1);
  constexpr std::uintptr_t kPage = std::uintptr_t{2} << 20;
  const auto begin = (reinterpret_cast<std::uintptr_t>(mat.datastart) + kPage - 1) & ~(kPage - 1);
  const auto end = reinterpret_cast<std::uintptr_t>(mat.dataend) & ~(kPage - 1);
  if (begin < end) (void)madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
  return mat;
}

void CheckInput(const cv::Mat& left, const cv::Mat& right, const cv::Mat& disparity_px, const RefineOptions& options,
                const cv::Mat& left_usable, const cv::Mat& right_usable) {
  if (left.type() != CV_32FC1 || right.type() != CV_32FC1 || disparity_px.type() != CV_32FC1 || left.empty() ||
      left.size() != right.size() || left.size() != disparity_px.size()) {
    throw std::invalid_argument("refinement: pictures and disparities must be CV_32FC1 of one size");
  }
  for (const cv::Mat* usable : {&left_usable, &right_usable}) {
    if (!usable->empty() && (usable->type() != CV_8UC1 || usable->size() != left.size())) {
      throw std::invalid_argument("refinement: the masks must be CV_8UC1 of the pictures' size");
    }
  }
  if (options.radius_px < 1 || options.radius_px > kRefineMaxRadius_px) {
    throw std::invalid_argument("refinement: the half window must be 1 to " + std::to_string(kRefineMaxRadius_px) +
                                " px, not " + std::to_string(options.radius_px));
  }
  if (options.iterations < 1) throw std::invalid_argument("refinement: there must be at least one pass");
  if (!(options.max_shift_px > 0)) throw std::invalid_argument("refinement: the largest shift must be positive");
}

}  // namespace

Refined RefineDisparity(const cv::Mat& left, const cv::Mat& right, const cv::Mat& disparity_px,
                        const RefineOptions& options, const cv::Mat& left_usable, const cv::Mat& right_usable) {
  CheckInput(left, right, disparity_px, options, left_usable, right_usable);
  const int width = left.cols, height = left.rows, radius = options.radius_px;
  const Offsets offsets = WindowOffsets(radius);
  const Pictures pictures{
      left, right, left_usable, right_usable, MeasureContrast(left, left_usable), MeasureContrast(right, right_usable)};
  cv::Mat current = LargeMat(height, RefineWidth(width)), start = LargeMat(height, RefineWidth(width));
  cv::Mat window(height, width, CV_8UC1);
  Refined out{LargeMat(height, width), LargeMat(height, width)};
  ForEachBand(height, [&](int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      float* row = current.ptr<float>(y);
      std::fill(std::copy_n(disparity_px.ptr<float>(y), width, row), row + current.cols, kInfinity);
    }
  });

  for (int i = 0; i + 1 < options.iterations; ++i) {
    FindStarts(current, width, radius, start, window);
    ForEachBand(height, [&](int y0, int y1) {
      SolveBand(pictures, start, radius, y0, y1, nullptr, [&](int y, auto shifts) {
        const float *s = start.ptr<float>(y), *own = shifts(y).delta_px;
        const std::uint8_t* w = window.ptr<std::uint8_t>(y);
        float* d = current.ptr<float>(y);
        for (int x = 0; x < width; ++x) {
          if (std::isnan(s[x])) continue;
          float delta = own[x];
          if (w[x] != 0) delta = shifts(y + offsets[w[x]].dy).delta_px[x + offsets[w[x]].dx];
          d[x] = std::isnan(delta) ? s[x] : s[x] + std::clamp(delta, -1.0f, 1.0f);
        }
      });
    });
  }

  FindStarts(current, width, radius, start, window);
  std::vector<std::array<double, 4>> products((height + kBandRows - 1) / kBandRows);
  const float max_shift = static_cast<float>(options.max_shift_px);
  // A plane's value beside its window is less sure than in its middle, and the surface may bend.
  constexpr float kBend_px = 0.1f;
  const float spread = static_cast<float>(radius * (radius + 1)) / 3;
  ForEachBand(height, [&](int y0, int y1) {
    SolveBand(pictures, start, radius, y0, y1, products[y0 / kBandRows].data(), [&](int y, auto shifts) {
      const float *s = start.ptr<float>(y), *before = disparity_px.ptr<float>(y);
      const ShiftRow own = shifts(y);
      const std::uint8_t* w = window.ptr<std::uint8_t>(y);
      float *d = out.disparity_px.ptr<float>(y), *deviation = out.deviation_px.ptr<float>(y);
      for (int x = 0; x < width; ++x) {
        float delta = own.delta_px[x], sigma = own.deviation_px[x];
        if (w[x] != 0 && w[x] != kNoWindow) {
          const auto [dx, dy, far] = offsets[w[x]];
          const ShiftRow there = shifts(y + dy);
          delta = there.delta_px[x + dx];
          sigma = there.deviation_px[x + dx];
          sigma = std::sqrt(sigma * sigma * (1 + static_cast<float>(dx * dx + dy * dy) / spread) + kBend_px * kBend_px);
        }
        const float after = s[x] + delta;
        const bool refined =
            std::abs(delta) < 0.5f && std::abs(after - before[x]) <= max_shift && sigma < kUnrefinedDeviation_px;
        d[x] = refined ? after : before[x];
        deviation[x] = refined ? sigma : std::isfinite(before[x]) ? kUnrefinedDeviation_px : kNan;
      }
    });
  });
  // Each pass adds the noise of the planes that the one before left it: 1.16 for windows of even weight, 1.10 measured
  // for dots, whose weights are uneven.
  const float passes = options.iterations == 1 ? 1.0f : options.iterations == 2 ? 1.07f : 1.10f;
  const float factor = passes * NeighbourFactor(products);
  ForEachBand(height, [&](int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      float* deviation = out.deviation_px.ptr<float>(y);
      for (int x = 0; x < width; ++x) {
        if (deviation[x] != kUnrefinedDeviation_px) deviation[x] *= factor;
      }
    }
  });
  return out;
}

}  // namespace granary
