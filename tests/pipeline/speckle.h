// Synthetic stereo pairs whose disparity is known at every pixel: a continuous dot pattern, evaluated where each camera
// looks. Nothing is resampled, so that no interpolation error of the test's own hides the matcher's.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <vector>

#include <opencv2/core.hpp>

namespace granary {

/// Sum of Gaussian dots of 2.2 px full width at half maximum, as a function of the left picture's coordinates.
class Speckle {
 public:
  Speckle(cv::Size size, unsigned seed, double dots_per_px2 = 0.12) : columns_(size.width / kCell + 2 * kMargin) {
    const int rows = size.height / kCell + 2 * kMargin;
    cells_.resize(static_cast<std::size_t>(columns_) * rows);
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(0, 1);
    const int count = static_cast<int>(dots_per_px2 * columns_ * rows * kCell * kCell);
    for (int i = 0; i < count; ++i) {
      const double x = unit(random) * columns_ * kCell, y = unit(random) * rows * kCell;
      cells_[Index(static_cast<int>(x) / kCell, static_cast<int>(y) / kCell)].push_back(
          {x - kMargin * kCell, y - kMargin * kCell, 50 + 70 * unit(random)});
    }
  }

  /// Grey level at a place of the left picture; up to 80 px beyond its edges.
  [[nodiscard]] double At(double x, double y) const {
    constexpr double kSigma = 2.2 / 2.3548;
    const int i = static_cast<int>(std::floor(x / kCell)) + kMargin,
              j = static_cast<int>(std::floor(y / kCell)) + kMargin;
    double grey = 30;
    for (int v = j - 1; v <= j + 1; ++v) {
      for (int u = i - 1; u <= i + 1; ++u) {
        for (const Dot& dot : cells_.at(Index(u, v))) {
          const double square = (x - dot.x) * (x - dot.x) + (y - dot.y) * (y - dot.y);
          grey += dot.grey * std::exp(-square / (2 * kSigma * kSigma));
        }
      }
    }
    return grey;
  }

 private:
  struct Dot {
    double x, y, grey;
  };
  static constexpr int kCell = 4, kMargin = 22;
  [[nodiscard]] std::size_t Index(int i, int j) const { return static_cast<std::size_t>(j) * columns_ + i; }
  int columns_;
  std::vector<std::vector<Dot>> cells_;
};

/// An 8-bit picture of `grey(x, y)` with Gaussian noise.
inline cv::Mat Render(cv::Size size, double noise, unsigned seed, const std::function<double(int, int)>& grey) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0, 1);
  cv::Mat picture(size, CV_8UC1);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      picture.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(grey(x, y) + noise * normal(random));
    }
  }
  return picture;
}

struct StereoPair {
  cv::Mat left, right;  // CV_8UC1
};

/// A plane whose disparity at the left pixel (x, y) is `d0 + slope_x · x + slope_y · y`.
struct DisparityPlane {
  double d0 = 0, slope_x = 0, slope_y = 0;
  [[nodiscard]] double At(double x, double y) const { return d0 + slope_x * x + slope_y * y; }
  /// The left column that the right pixel (x, y) shows.
  [[nodiscard]] double LeftColumn(double x, double y) const { return (x + d0 + slope_y * y) / (1 - slope_x); }
};

/// The right camera sees 0.7 times the grey levels of the left one.
inline StereoPair RenderPlane(cv::Size size, const DisparityPlane& plane, double noise, unsigned seed) {
  const Speckle speckle(size, seed);
  return {Render(size, noise, seed + 1000, [&](int x, int y) { return speckle.At(x, y); }),
          Render(size, noise, seed + 2000, [&](int x, int y) { return 0.7 * speckle.At(plane.LeftColumn(x, y), y); })};
}

/// How a measured disparity departs from the truth over the valid pixels that keep clear of the picture's edges.
struct DisparityError {
  double bias_px = 0, rms_px = 0;
  double locking_px = 0;     ///< peak to peak of the mean error over 20 classes of the true fraction
  double valid_share = 0;    ///< of the pixels that both pictures see
  double outlier_share = 0;  ///< of the valid ones, those off by more than a pixel; left out of the figures above
};

inline DisparityError CompareWithPlane(const cv::Mat& disparity_px, const DisparityPlane& plane, int margin_px = 16) {
  constexpr int kClasses = 20;
  std::vector<double> sum(kClasses, 0), count(kClasses, 0);
  double n = 0, total = 0, squares = 0, seen = 0, outliers = 0;
  for (int y = margin_px; y < disparity_px.rows - margin_px; ++y) {
    for (int x = margin_px; x < disparity_px.cols - margin_px; ++x) {
      const double truth = plane.At(x, y);
      if (x - truth < margin_px || x - truth >= disparity_px.cols - margin_px) continue;
      ++seen;
      const double error = disparity_px.at<float>(y, x) - truth;
      if (!std::isfinite(error)) continue;
      if (std::abs(error) > 1) {
        ++outliers;
        continue;
      }
      ++n;
      total += error;
      squares += error * error;
      const int k = std::min(kClasses - 1, static_cast<int>((truth - std::floor(truth)) * kClasses));
      sum[k] += error;
      ++count[k];
    }
  }
  double low = 1e9, high = -1e9;
  for (int k = 0; k < kClasses; ++k) {
    if (count[k] == 0) continue;
    low = std::min(low, sum[k] / count[k]);
    high = std::max(high, sum[k] / count[k]);
  }
  return {total / n, std::sqrt(squares / n), high - low, (n + outliers) / seen, outliers / (n + outliers)};
}

}  // namespace granary
