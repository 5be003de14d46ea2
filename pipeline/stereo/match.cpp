// Checks what it is given, then searches and refines.
#include "pipeline/stereo/match.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>

#include <opencv2/core.hpp>

#include "pipeline/stereo/agreement.h"
#include "pipeline/stereo/coarse.h"
#include "pipeline/stereo/for_each_row.h"
#include "pipeline/stereo/refine.h"

namespace granary {

namespace {

constexpr int kMostDisparities = 2047;  // blobs are found in sixteenths of a pixel, 16 bits

void CheckPicture(const cv::Mat& grey, const char* side) {
  const std::string name = std::string("matching: the ") + side + " picture ";
  if (grey.empty()) throw std::invalid_argument(name + "is empty");
  if (grey.type() != CV_8UC1 && grey.type() != CV_16UC1 && grey.type() != CV_32FC1) {
    throw std::invalid_argument(name + "must have one channel of 8 or 16 bits, or float");
  }
  if (grey.type() == CV_32FC1 && !cv::checkRange(grey)) {
    throw std::invalid_argument(name + "must be finite; pixels without a grey level belong in a mask");
  }
}

void CheckInput(const cv::Mat& left, const cv::Mat& right, DisparityRange range, const StereoOptions& options,
                const UsablePixels& usable) {
  if (left.size() != right.size()) throw std::invalid_argument("matching: the pictures differ in size");
  if (left.type() != right.type()) throw std::invalid_argument("matching: the pictures differ in depth or channels");
  CheckPicture(left, "left");
  CheckPicture(right, "right");
  for (const cv::Mat* mask : {&usable.left, &usable.right}) {
    if (!mask->empty() && (mask->size() != left.size() || mask->type() != CV_8UC1)) {
      throw std::invalid_argument("matching: a mask of usable pixels must be CV_8UC1 and have the pictures' size");
    }
  }
  if (range.count < 1 || range.count > kMostDisparities) {
    throw std::invalid_argument("matching: the number of disparities must be 1 to " + std::to_string(kMostDisparities) +
                                ", not " + std::to_string(range.count));
  }
  const std::int64_t first = range.min_px, last = first + range.count - 1;
  if (first >= left.cols || last <= -left.cols) {
    throw std::invalid_argument("matching: disparities " + std::to_string(first) + " to " + std::to_string(last) +
                                " leave no overlap in a picture " + std::to_string(left.cols) + " px wide");
  }
  if (const auto faults = Faults(options); !faults.empty()) throw std::invalid_argument("matching: " + faults.front());
}

// The mask given, without the areas of a whole-number picture where the sensor was full; empty when all is usable.
cv::Mat WithoutSaturated(const cv::Mat& picture, const cv::Mat& usable) {
  if (picture.depth() == CV_32F) return usable;
  const cv::Mat full = picture == (picture.depth() == CV_8U ? 255 : 65535);
  if (cv::countNonZero(full) == 0) return usable;
  const cv::Mat unsaturated = ~SaturatedAreas(full);
  return usable.empty() ? unsaturated : cv::Mat(unsaturated & usable);
}

// Paths carry disparities into the dark, where noise then seems to confirm some of them: what the refinement could not
// settle stays only if the pixel's own census windows agree.
void DropAccidents(const GreyPair& pair, const StereoOptions& options, Refined& refined) {
  constexpr double kMatch = 0.5;  // of the contrast, as the refinement asks
  ForEachRow(pair.left.rows, [&](int y) {
    float* disparity = refined.disparity_px.ptr<float>(y);
    float* deviation = refined.deviation_px.ptr<float>(y);
    for (int x = 0; x < pair.left.cols; ++x) {
      if (!(deviation[x] >= kUnrefinedDeviation_px)) continue;
      if (ExplainedContrast(pair.left, pair.right, x, y, disparity[x], options.census_width / 2,
                            options.census_height / 2) >= kMatch) {
        continue;
      }
      disparity[x] = std::numeric_limits<float>::infinity();
      deviation[x] = std::numeric_limits<float>::quiet_NaN();
    }
  });
}

}  // namespace

StereoResult MatchStereo(const cv::Mat& left, const cv::Mat& right, DisparityRange range, const StereoOptions& options,
                         const UsablePixels& usable, MatchBuffers* buffers) {
  CheckInput(left, right, range, options, usable);
  MatchBuffers own;
  MatchBuffers& memory = buffers == nullptr ? own : *buffers;
  GreyPair& pair = memory.pair;
  left.convertTo(pair.left, CV_32FC1);
  right.convertTo(pair.right, CV_32FC1);
  pair.usable = {WithoutSaturated(left, usable.left), WithoutSaturated(right, usable.right)};
  pair.levels_of_255 = left.type() == CV_16UC1 ? 1.0 / 257 : 1.0;

  std::optional<DisparityTiles> tiles;
  if (options.coarse_to_fine) tiles = ProposeTiles(pair, range, options);
  const cv::Mat disparity = SearchDisparity(pair, range, options, tiles ? &*tiles : nullptr, memory.search);
  if (options.refine_radius_px == 0) {
    cv::Mat deviation(disparity.size(), CV_32FC1);
    ForEachRow(disparity.rows, [&](int y) {
      std::transform(disparity.ptr<float>(y), disparity.ptr<float>(y) + disparity.cols, deviation.ptr<float>(y),
                     [](float d) {
                       return d < std::numeric_limits<float>::infinity() ? kUnrefinedDeviation_px
                                                                         : std::numeric_limits<float>::quiet_NaN();
                     });
    });
    return {disparity, deviation};
  }
  Refined refined = RefineDisparity(pair.left, pair.right, disparity, {.radius_px = options.refine_radius_px},
                                    pair.usable.left, pair.usable.right);
  DropAccidents(pair, options, refined);
  return {refined.disparity_px, refined.deviation_px};
}

}  // namespace granary
