// Passes of two stages over bands of fixed height, whatever the threads: planes through the disparities give every
// pixel a start that follows its surface; grey values then say what the start lacks. All windows of a row are summed at
// once, so the cost of a pixel hardly depends on the window.
#include "pipeline/stereo/refine.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <opencv2/core.hpp>

#include "pipeline/stereo/refine_bands.h"
#include "pipeline/stereo/refine_rows.h"
#include "pipeline/stereo/refine_starts.h"

namespace granary {

namespace {

constexpr float kLeastDeviation_px = 0.001f;  // of exact copies: what the spline and sums of floats leave
constexpr float kMaxLastShift_px = 0.5f;      // more in the last pass: the passes do not converge
constexpr int kBandRows = 128;
constexpr float kInfinity = std::numeric_limits<float>::infinity();

template <typename Body>
void ForEachBand(int height, Body body) {
  const int bands = (height + kBandRows - 1) / kBandRows;
  tbb::parallel_for(0, bands, [&](int band) { body(band * kBandRows, std::min(height, (band + 1) * kBandRows)); });
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
  const Contrast l = MeasureContrast(left, left_usable), r = MeasureContrast(right, right_usable);
  const RefinePictures pictures{
      left, right, left_usable, right_usable, l.mean, r.mean, r.deviation > 0 ? l.deviation / r.deviation : 1};
  tbb::enumerable_thread_specific<StartBuffers> start_buffers(radius, width);
  tbb::enumerable_thread_specific<ShiftBuffers> shift_buffers(radius, width);

  cv::Mat current(height, RefineWidth(width), CV_32FC1), start(height, RefineWidth(width), CV_32FC1);
  cv::Mat window(height, width, CV_8UC1);
  ForEachBand(height, [&](int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      float* row = current.ptr<float>(y);
      std::fill(std::copy_n(disparity_px.ptr<float>(y), width, row), row + current.cols, kInfinity);
    }
  });
  const auto find_starts = [&] {
    ForEachBand(height, [&](int y0, int y1) {
      FindStarts(current, width, radius, y0, y1, start_buffers.local(), start, window);
    });
  };
  for (int i = 0; i + 1 < options.iterations; ++i) {
    find_starts();
    ForEachBand(height, [&](int y0, int y1) {
      MoveBand(pictures, start, window, radius, y0, y1, shift_buffers.local(), current);
    });
  }

  find_starts();
  // The last pass no longer reads what the ones before found, only their planes.
  cv::Mat refined = current.colRange(0, width), deviation_px(height, width, CV_32FC1);
  const RefineLimits limits{static_cast<float>(options.max_shift_px), kMaxLastShift_px, kUnrefinedDeviation_px};
  std::vector<std::array<double, 4>> products((height + kBandRows - 1) / kBandRows);
  ForEachBand(height, [&](int y0, int y1) {
    FinishBand(pictures, start, window, radius, y0, y1, disparity_px, limits, shift_buffers.local(), refined,
               deviation_px, products[y0 / kBandRows].data());
  });

  // Each pass adds the noise of the planes that the one before left it: 1.16 for windows of even weight, 1.10 measured
  // for dots, whose weights are uneven.
  const float passes = options.iterations == 1 ? 1.0f : options.iterations == 2 ? 1.07f : 1.10f;
  const float factor = passes * NeighbourFactor(products);
  ForEachBand(height, [&](int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      float* deviation = deviation_px.ptr<float>(y);
      for (int x = 0; x < width; ++x) {
        if (deviation[x] != kUnrefinedDeviation_px) deviation[x] = std::max(deviation[x] * factor, kLeastDeviation_px);
      }
    }
  });
  return {refined.isContinuous() ? refined : refined.clone(), deviation_px};
}

}  // namespace granary
