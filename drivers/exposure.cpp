// What a sensor clips in the long exposure it still tells apart in a shorter one; the sum of both has more bits.
#include "drivers/exposure.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <opencv2/core.hpp>

namespace granary {
namespace {

// Within a fiftieth of the full scale a pixel's noise may have been clipped, and sensors bend.
constexpr double kFullShare = 0.98;

cv::Mat FullPixels(const Frame& frame) { return frame.image >= kFullShare * frame.SaturationLevel(); }

}  // namespace

double SaturatedShare(const Frame& frame) {
  return static_cast<double>(cv::countNonZero(FullPixels(frame))) / static_cast<double>(frame.image.total());
}

Frame MergeBrackets(const std::vector<Frame>& longest_first) {
  if (longest_first.empty()) throw std::invalid_argument("MergeBrackets: no picture");
  const Frame& longest = longest_first.front();
  for (const Frame& frame : longest_first) {
    if (frame.image.size() != longest.image.size() || frame.image.type() != longest.image.type() ||
        frame.bit_depth != longest.bit_depth) {
      throw std::invalid_argument("MergeBrackets: " + frame.source + " differs in size, type or bits from " +
                                  longest.source);
    }
  }
  if (longest_first.size() == 1) return longest;

  const int extra_bits = 2 * static_cast<int>(longest_first.size() - 1);
  Frame merged = longest;
  merged.bit_depth = std::min(16, longest.bit_depth + extra_bits);
  const double scale =
      std::exp2(merged.bit_depth - longest.bit_depth - extra_bits);  // below 1 where 16 bits are too few
  merged.image = cv::Mat();  // not into the pixels of the longest
  longest.image.convertTo(merged.image, CV_16U, scale);
  double ratio = 1;
  for (std::size_t i = 1; i < longest_first.size(); ++i) {
    ratio *= kBracketRatio;
    cv::Mat shorter;
    longest_first[i].image.convertTo(shorter, CV_16U, scale * ratio);
    // A pixel of a clipped one is never darker than the clipped level itself, whatever the shorter one's noise says.
    cv::max(shorter, merged.image, shorter);
    shorter.copyTo(merged.image, FullPixels(longest_first[i - 1]));
  }
  return merged;
}

}  // namespace granary
