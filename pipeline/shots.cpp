// Noise of a matched pixel is some hundredths of a pixel: a difference of a whole one is another surface.
#include "pipeline/shots.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <opencv2/imgproc.hpp>

namespace granary {

namespace {

constexpr float kMoved_px = 1.0f;
constexpr float kMovedDeviations = 10;  // where the match itself is unsure
constexpr int kMovedPatch_px = 7;       // smaller patches are stray matches at edges

}  // namespace

FusedDisparities FuseDisparities(const std::vector<cv::Mat>& disparities, const std::vector<cv::Mat>& deviations) {
  if (disparities.empty() || disparities.size() != deviations.size()) {
    throw std::invalid_argument("FuseDisparities: " + std::to_string(disparities.size()) + " disparities, " +
                                std::to_string(deviations.size()) + " deviations; as many are wanted, at least one");
  }
  const cv::Size size = disparities.front().size();
  for (std::size_t k = 0; k < disparities.size(); ++k) {
    if (disparities[k].size() != size || deviations[k].size() != size) {
      throw std::invalid_argument("FuseDisparities: the pictures differ in size");
    }
  }
  FusedDisparities out;
  out.disparity_px = cv::Mat(size, CV_32FC1);
  out.deviation_px = cv::Mat(size, CV_32FC1);
  cv::Mat moved = cv::Mat::zeros(size, CV_8UC1);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      float low = std::numeric_limits<float>::infinity(), high = -low, sum = 0, variance = 0;
      std::size_t seen = 0;
      for (std::size_t k = 0; k < disparities.size(); ++k) {
        const float d = disparities[k].at<float>(y, x);
        if (!std::isfinite(d)) continue;
        const float deviation = deviations[k].at<float>(y, x);
        ++seen;
        sum += d;
        variance += deviation * deviation;
        low = std::min(low, d);
        high = std::max(high, d);
      }
      const auto n = static_cast<float>(seen);
      const bool differs = seen > 1 && high - low > std::max(kMoved_px, kMovedDeviations * std::sqrt(variance / n));
      if (differs) moved.at<std::uint8_t>(y, x) = 255;
      const bool kept = !differs && 2 * seen > disparities.size();
      out.disparity_px.at<float>(y, x) = kept ? sum / n : std::numeric_limits<float>::infinity();
      out.deviation_px.at<float>(y, x) = kept ? std::sqrt(variance) / n : std::numeric_limits<float>::quiet_NaN();
    }
  }
  cv::morphologyEx(moved, out.moved, cv::MORPH_OPEN, cv::Mat::ones(kMovedPatch_px, kMovedPatch_px, CV_8UC1));
  return out;
}

double StandardDeviation(const std::vector<double>& values) {
  if (values.size() < 2) return std::numeric_limits<double>::quiet_NaN();
  double mean = 0, squares = 0;
  for (const double value : values) mean += value / static_cast<double>(values.size());
  for (const double value : values) squares += (value - mean) * (value - mean);
  return std::sqrt(squares / static_cast<double>(values.size() - 1));
}

double RelativeDeviation_percent(const std::vector<double>& values) {
  double mean = 0;
  for (const double value : values) mean += value / static_cast<double>(values.size());
  if (!(mean > 0)) return std::numeric_limits<double>::quiet_NaN();
  return 100 * StandardDeviation(values) / mean;
}

}  // namespace granary
