// All windows at once: the products that the normal equations need are formed a pixel and summed by box filters, so the
// cost of a pixel does not depend on the window. The picture is cut into bands of fixed height, whatever the threads.
#include "pipeline/stereo/refine.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include <tbb/parallel_for.h>
#include <opencv2/core.hpp>

namespace granary {

namespace {

constexpr float kUnrefinedDeviation_px = 0.3f;  // census + SGM + equiangular, see docs/method.md
constexpr int kBandRows = 64;

// Slope at r[0], right to fourth order: the plain central difference sees 0.8 of the slope of dots 2 px wide.
float Slope(const float* r) { return (8 * (r[1] - r[-1]) - (r[2] - r[-2])) / 12; }

// Value at fraction t between r[0] and r[1]: a cubic through both with those slopes. Catmull–Rom, whose slopes are
// central differences, moves a dot by up to 0.013 px too little on either side of whole disparities.
float Interpolate(const float* r, float t) {
  const float b = r[0], c = r[1], slope_b = Slope(r), slope_c = Slope(r + 1);
  return b + t * (slope_b + t * (3 * (c - b) - 2 * slope_b - slope_c + t * (2 * (b - c) + slope_b + slope_c)));
}

// Sums over a (2r + 1)² window for `channels` values a pixel: a running sum down each column, then along the row.
class BoxSums {
 public:
  BoxSums(int width, int radius, int channels)
      : width_(width),
        radius_(radius),
        channels_(channels),
        columns_(static_cast<std::size_t>(width) * channels, 0.0),
        sums_(columns_.size(), 0.0) {}

  void AddRow(const float* values) { Accumulate(values, 1.0); }
  void DropRow(const float* values) { Accumulate(values, -1.0); }

  /// Window sums of the rows now held, `channels` a pixel.
  const double* Row() {
    std::vector<double> run(channels_, 0.0);
    const auto column = [&](int x) { return columns_.data() + static_cast<std::size_t>(x) * channels_; };
    for (int x = 0; x < std::min(radius_, width_); ++x) {
      for (int c = 0; c < channels_; ++c) run[c] += column(x)[c];
    }
    for (int x = 0; x < width_; ++x) {
      double* out = sums_.data() + static_cast<std::size_t>(x) * channels_;
      if (x + radius_ < width_) {
        const double* in = column(x + radius_);
        for (int c = 0; c < channels_; ++c) run[c] += in[c];
      }
      for (int c = 0; c < channels_; ++c) out[c] = run[c];
      if (x - radius_ >= 0) {
        const double* gone = column(x - radius_);
        for (int c = 0; c < channels_; ++c) run[c] -= gone[c];
      }
    }
    return sums_.data();
  }

 private:
  void Accumulate(const float* values, double sign) {
    for (std::size_t i = 0; i < columns_.size(); ++i) columns_[i] += sign * values[i];
  }
  int width_, radius_, channels_;
  std::vector<double> columns_, sums_;
};

// Runs `row_values(y, out)` for every row the windows of a band touch and `use(y, sums)` for every row of the band.
template <typename RowValues, typename Use>
void SlideWindow(int y0, int y1, int height, int width, int radius, int channels, RowValues row_values, Use use) {
  BoxSums box(width, radius, channels);
  const std::size_t row_size = static_cast<std::size_t>(width) * channels;
  const int kept = 2 * radius + 1;
  std::vector<float> ring(row_size * kept);
  const auto slot = [&](int y) { return ring.data() + row_size * static_cast<std::size_t>(y % kept); };
  int next = std::max(0, y0 - radius);
  for (int y = y0; y < y1; ++y) {
    if (y - radius - 1 >= std::max(0, y0 - radius)) box.DropRow(slot(y - radius - 1));
    for (; next <= std::min(height - 1, y + radius); ++next) {
      row_values(next, slot(next));
      box.AddRow(slot(next));
    }
    use(y, box.Row());
  }
}

template <typename Body>
void ForEachBand(int height, Body body) {
  const int bands = (height + kBandRows - 1) / kBandRows;
  tbb::parallel_for(0, bands, [&](int band) { body(band * kBandRows, std::min(height, (band + 1) * kBandRows)); });
}

// Mean of the valid disparities in each window; pixels whose window straddles a step keep their own value and are
// marked. A window on a plane of slope g has variance g²(n² − 1)/12 a direction: 3 px² allows slopes up to about 0.4.
struct Smoothed {
  cv::Mat disparity_px;
  cv::Mat steady;  // CV_8UC1
};

Smoothed SmoothDisparity(const cv::Mat& disparity, int radius) {
  constexpr double kStepVariance_px2 = 3.0;
  Smoothed out{disparity.clone(), cv::Mat::zeros(disparity.size(), CV_8UC1)};
  ForEachBand(disparity.rows, [&](int y0, int y1) {
    SlideWindow(
        y0, y1, disparity.rows, disparity.cols, radius, 5,
        [&](int y, float* values) {
          const float* d = disparity.ptr<float>(y);
          for (int x = 0; x < disparity.cols; ++x, values += 5) {
            const bool valid = std::isfinite(d[x]);
            values[0] = valid ? 1.0f : 0.0f;
            values[1] = valid ? d[x] : 0.0f;
            values[2] = valid ? d[x] * d[x] : 0.0f;
            values[3] = valid ? static_cast<float>(x) : 0.0f;
            values[4] = valid ? static_cast<float>(y) : 0.0f;
          }
        },
        [&](int y, const double* sums) {
          const int full = (2 * radius + 1) * (2 * radius + 1);
          for (int x = 0; x < disparity.cols; ++x, sums += 5) {
            if (!std::isfinite(disparity.at<float>(y, x)) || sums[0] < full / 2.0) continue;
            const double mean = sums[1] / sums[0];
            if (sums[2] / sums[0] - mean * mean > kStepVariance_px2) continue;
            out.steady.at<std::uint8_t>(y, x) = 255;
            // Only a window whose valid pixels are centred may be replaced by its mean: elsewhere the slope would leak
            // in.
            const bool centred = std::abs(sums[3] / sums[0] - x) < 0.25 && std::abs(sums[4] / sums[0] - y) < 0.25;
            if (centred) out.disparity_px.at<float>(y, x) = static_cast<float>(mean);
          }
        });
  });
  return out;
}

enum Channel { kCount, kL, kR, kG, kLL, kRR, kGG, kLR, kLG, kRG, kChannels };

struct Shift {
  cv::Mat delta_px;  // NaN where the window gives none
  cv::Mat deviation_px;
  cv::Mat residual;  // mean squared residual, grey²
};

Shift SolveShift(const cv::Mat& left, const cv::Mat& right, const cv::Mat& disparity, const cv::Mat& steady,
                 int radius) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  Shift out{cv::Mat(left.size(), CV_32FC1, cv::Scalar(nan)), cv::Mat(left.size(), CV_32FC1, cv::Scalar(nan)),
            cv::Mat(left.size(), CV_32FC1, cv::Scalar(nan))};
  const int width = left.cols, height = left.rows;

  ForEachBand(height, [&](int y0, int y1) {
    std::vector<float> warped(width);
    SlideWindow(
        y0, y1, height, width, radius, kChannels,
        [&](int y, float* values) {
          const float* l = left.ptr<float>(y);
          const float* r = right.ptr<float>(y);
          const float* d = disparity.ptr<float>(y);
          for (int x = 0; x < width; ++x) {
            warped[x] = nan;
            const float at = static_cast<float>(x) - d[x];
            if (!(at >= 2.0f && at < static_cast<float>(width - 3))) continue;
            const int i = static_cast<int>(at);
            warped[x] = Interpolate(r + i, at - static_cast<float>(i));
          }
          for (int x = 0; x < width; ++x, values += kChannels) {
            std::fill(values, values + kChannels, 0.0f);
            if (x < 1 || x + 1 >= width || !std::isfinite(warped[x - 1]) || !std::isfinite(warped[x]) ||
                !std::isfinite(warped[x + 1])) {
              continue;
            }
            // The gradient of the mean of both pictures: noise in one alone would pull δ towards 0.
            const bool wide = x >= 2 && x + 2 < width && std::isfinite(warped[x - 2]) && std::isfinite(warped[x + 2]);
            const float w = warped[x];
            const float g = wide ? 0.5f * (Slope(l + x) + Slope(warped.data() + x))
                                 : 0.25f * (l[x + 1] - l[x - 1] + warped[x + 1] - warped[x - 1]);
            values[kCount] = 1;
            values[kL] = l[x];
            values[kR] = w;
            values[kG] = g;
            values[kLL] = l[x] * l[x];
            values[kRR] = w * w;
            values[kGG] = g * g;
            values[kLR] = l[x] * w;
            values[kLG] = l[x] * g;
            values[kRG] = w * g;
          }
        },
        [&](int y, const double* s) {
          const double full = (2.0 * radius + 1) * (2.0 * radius + 1);
          for (int x = 0; x < width; ++x, s += kChannels) {
            if (steady.at<std::uint8_t>(y, x) == 0 || s[kCount] < 0.6 * full) continue;
            const double n = s[kCount];
            const double ll = s[kLL] - s[kL] * s[kL] / n, rr = s[kRR] - s[kR] * s[kR] / n;
            const double gg = s[kGG] - s[kG] * s[kG] / n, lr = s[kLR] - s[kL] * s[kR] / n;
            const double lg = s[kLG] - s[kL] * s[kG] / n, rg = s[kRG] - s[kR] * s[kG] / n;
            // l = gain·w − δ·g: two unknowns after the means are taken out
            const double det = rr * gg - rg * rg;
            if (!(det > 1e-6 * rr * gg) || rr <= 0 || gg <= 0) continue;
            const double gain = (lr * gg - lg * rg) / det;
            const double slope = (lg * rr - lr * rg) / det;  // −δ
            const double residual = std::max(0.0, ll - gain * lr - slope * lg);
            if (gain < 0.2 || gain > 5) continue;
            out.delta_px.at<float>(y, x) = static_cast<float>(-slope);
            out.residual.at<float>(y, x) = static_cast<float>(residual / n);
            out.deviation_px.at<float>(y, x) = static_cast<float>(std::sqrt(residual / (n - 3) * rr / det));
          }
        });
  });
  return out;
}

// The right picture with the contrast of the left one: the slopes of both can then stand for one another.
cv::Mat WithContrastOf(const cv::Mat& left, const cv::Mat& right) {
  cv::Scalar mean, left_contrast, right_contrast;
  cv::meanStdDev(left, mean, left_contrast);
  cv::meanStdDev(right, mean, right_contrast);
  return right_contrast[0] > 0 ? cv::Mat(right * (left_contrast[0] / right_contrast[0])) : right;
}

}  // namespace

Refined RefineDisparity(const cv::Mat& left, const cv::Mat& right, const cv::Mat& disparity_px,
                        const RefineOptions& options) {
  if (left.type() != CV_32FC1 || right.type() != CV_32FC1 || disparity_px.type() != CV_32FC1 ||
      left.size() != right.size() || left.size() != disparity_px.size()) {
    throw std::invalid_argument("refinement: pictures and disparities must be CV_32FC1 of one size");
  }
  const cv::Mat balanced = WithContrastOf(left, right);
  cv::Mat current = disparity_px;
  Shift shift;
  cv::Mat first_residual;
  for (int i = 0; i < options.iterations; ++i) {
    // Smoothed before each pass: δ is what the window lacks on average, and would add its own noise once a pass to a
    // start that differs from pixel to pixel.
    Smoothed start = SmoothDisparity(current, options.radius_px);
    shift = SolveShift(left, balanced, start.disparity_px, start.steady, options.radius_px);
    if (i == 0) first_residual = shift.residual;
    current = start.disparity_px;
    for (int y = 0; y < current.rows; ++y) {
      for (int x = 0; x < current.cols; ++x) {
        const float delta = shift.delta_px.at<float>(y, x);
        if (std::isfinite(delta)) current.at<float>(y, x) += std::clamp(delta, -1.0f, 1.0f);
      }
    }
  }
  Refined out{disparity_px.clone(), cv::Mat(disparity_px.size(), CV_32FC1)};
  for (int y = 0; y < current.rows; ++y) {
    for (int x = 0; x < current.cols; ++x) {
      float& deviation = out.deviation_px.at<float>(y, x);
      const float before = disparity_px.at<float>(y, x);
      if (!std::isfinite(before)) {
        deviation = std::numeric_limits<float>::quiet_NaN();
        continue;
      }
      deviation = kUnrefinedDeviation_px;
      const float after = current.at<float>(y, x);
      const bool solved = std::isfinite(shift.delta_px.at<float>(y, x));
      const bool settled = std::abs(shift.delta_px.at<float>(y, x)) < 0.5f;
      const bool near = std::abs(after - before) <= options.max_shift_px;
      if (!solved || !settled || !near || shift.residual.at<float>(y, x) > 1.1f * first_residual.at<float>(y, x))
        continue;
      out.disparity_px.at<float>(y, x) = after;
      deviation = shift.deviation_px.at<float>(y, x);
    }
  }
  return out;
}

}  // namespace granary
