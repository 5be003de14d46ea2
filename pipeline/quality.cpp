// Dots are a few pixels wide: what a blur of that size takes away is speckle, what it leaves is shape and shade.
#include "pipeline/quality.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "pipeline/text.h"

namespace granary {

namespace {

// Below this share of the wanted contrast there are no dots at all: the lamp is dark, not the window dirty.
constexpr double kDarkProjectorShare = 0.65;

// Squares in which dots are looked for: some hundred dots each. What lies in a few of them, a lamp's glare, a ladder, a
// speck on the window, says nothing about the projector.
constexpr int kSquare_px = 32;

// Median over the squares inside the mask of the dots' RMS over the mean.
double MedianContrast(const cv::Mat& grey, const cv::Mat& power, const cv::Mat& mask) {
  std::vector<double> contrasts;
  for (int y = 0; y < grey.rows; y += kSquare_px) {
    for (int x = 0; x < grey.cols; x += kSquare_px) {
      const cv::Rect square = cv::Rect(x, y, kSquare_px, kSquare_px) & cv::Rect({0, 0}, grey.size());
      if (2 * cv::countNonZero(mask(square)) < square.area()) continue;
      const double mean = cv::mean(grey(square), mask(square))[0];
      const double rms = std::sqrt(cv::mean(power(square), mask(square))[0]);
      contrasts.push_back(mean > 0 ? rms / mean : 0);
    }
  }
  if (contrasts.empty()) return 0;
  const auto middle = contrasts.begin() + static_cast<std::ptrdiff_t>(contrasts.size() / 2);
  std::nth_element(contrasts.begin(), middle, contrasts.end());
  return *middle;
}

std::string Percent(const std::string& what, double value, const std::string& relation, double limit) {
  return FormatText((what + " %.1f %%, " + relation + " %.1f %%").c_str(), value * 100, limit * 100);
}

}  // namespace

PictureQuality AssessPicture(const cv::Mat& grey, const cv::Mat& mask) {
  // Texture between 2 and 9 px: the band of the dots. Noise of single pixels is averaged away by the small blur.
  cv::Mat fine, coarse, band, power;
  cv::GaussianBlur(grey, fine, {3, 3}, 0.8);
  cv::boxFilter(grey, coarse, CV_32F, {9, 9});
  band = fine - coarse;
  cv::multiply(band, band, power);
  const double mean = cv::mean(grey, mask)[0];
  cv::Mat full, share;
  cv::Mat(grey >= 254.5f).convertTo(full, CV_32FC1, 1.0 / 255);
  cv::boxFilter(full, share, CV_32F, {9, 9});
  const double saturated =
      static_cast<double>(cv::countNonZero((share > 0.5) & mask)) / std::max(1, cv::countNonZero(mask));
  return {mean / 255, MedianContrast(grey, power, mask), saturated};
}

PictureQuality AssessPictures(const RectifiedPair& pair, const cv::Mat& left_mask, const cv::Mat& right_mask) {
  const PictureQuality left = AssessPicture(pair.left, left_mask), right = AssessPicture(pair.right, right_mask);
  return {std::min(left.mean_fraction, right.mean_fraction), std::min(left.speckle_contrast, right.speckle_contrast),
          std::max(left.saturated_fraction, right.saturated_fraction)};
}

Verdict JudgePictures(const PictureQuality& quality, const QualityOptions& options) {
  if (quality.mean_fraction < options.min_mean_fraction) {
    return {Reason::kTooDark, Percent("mean grey", quality.mean_fraction, "at least", options.min_mean_fraction)};
  }
  if (quality.saturated_fraction > options.max_saturated_fraction) {
    return {Reason::kSaturated,
            Percent("saturated area", quality.saturated_fraction, "at most", options.max_saturated_fraction)};
  }
  if (quality.speckle_contrast < kDarkProjectorShare * options.min_speckle_contrast) {
    return {Reason::kProjectorDark,
            Percent("speckle contrast", quality.speckle_contrast, "at least", options.min_speckle_contrast)};
  }
  if (quality.speckle_contrast < options.min_speckle_contrast) {
    return {Reason::kLowContrast,
            Percent("speckle contrast", quality.speckle_contrast, "at least", options.min_speckle_contrast)};
  }
  return {};
}

}  // namespace granary
