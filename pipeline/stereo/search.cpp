// The order of METHOD §3: census, path costs, winners, median, left–right check, and what is left out.
#include "pipeline/stereo/search.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <stdexcept>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

namespace granary {

namespace {

constexpr float kInvalid = std::numeric_limits<float>::infinity();

// Disparities of either picture by its own winners, the left one's with its fraction; kNone where there is none.
constexpr float kNone = -1e6f;

template <typename Body>
void ForEachRow(int rows, Body body) {
  tbb::parallel_for(tbb::blocked_range<int>(0, rows, 16), [&](const tbb::blocked_range<int>& range) {
    for (int y = range.begin(); y < range.end(); ++y) body(y);
  });
}

void OwnDisparities(const Winners& winners, DisparityRange range, cv::Mat& left, cv::Mat& right) {
  const cv::Size size = winners.left_index.size();
  left.create(size, CV_32FC1);
  right.create(size, CV_32FC1);
  ForEachRow(size.height, [&](int y) {
    const std::int16_t* left_index = winners.left_index.ptr<std::int16_t>(y);
    const std::int16_t* right_index = winners.right_index.ptr<std::int16_t>(y);
    const float* offset = winners.subpixel.ptr<float>(y);
    const std::uint8_t* unique = winners.unique.ptr<std::uint8_t>(y);
    float* left_out = left.ptr<float>(y);
    float* right_out = right.ptr<float>(y);
    const float first = static_cast<float>(range.min_px);
    for (int x = 0; x < size.width; ++x) {
      const float value = first + static_cast<float>(left_index[x]) + offset[x];
      left_out[x] = left_index[x] >= 0 && unique[x] != 0 ? value : kNone;
      right_out[x] = right_index[x] >= 0 ? first + static_cast<float>(right_index[x]) : kNone;
    }
  });
}

// A left disparity is kept when the right picture's own at its partner points back to it; a fractional disparity has a
// partner on either side.
cv::Mat CheckedDisparity(const cv::Mat& left, const cv::Mat& right, DisparityRange range, int tolerance_px) {
  cv::Mat disparity(left.size(), CV_32FC1);
  const float limit = static_cast<float>(tolerance_px), first = static_cast<float>(range.min_px);
  ForEachRow(left.rows, [&](int y) {
    const float* left_row = left.ptr<float>(y);
    const float* right_row = right.ptr<float>(y);
    float* out = disparity.ptr<float>(y);
    for (int x = 0; x < left.cols; ++x) {
      out[x] = kInvalid;
      const float d = left_row[x];
      if (d == kNone) continue;
      // rounded; a disparity is never more than half a pixel below the least one
      const float whole = static_cast<float>(range.min_px + static_cast<int>(d - first + 0.5f));
      const int partner = std::clamp(x - static_cast<int>(whole), 0, left.cols - 1);
      const int between = std::clamp(partner + (d > whole ? -1 : 1), 0, left.cols - 1);
      const bool agrees =
          std::abs(right_row[partner] - whole) <= limit || std::abs(right_row[between] - whole) <= limit;
      if (agrees) out[x] = d;
    }
  });
  return disparity;
}

// Invalid where the pixel or its partner is not to be believed.
void KeepUsable(cv::Mat& disparity, const cv::Mat& left_usable, const cv::Mat& right_usable) {
  if (left_usable.empty() && right_usable.empty()) return;
  ForEachRow(disparity.rows, [&](int y) {
    const std::uint8_t* left = left_usable.empty() ? nullptr : left_usable.ptr<std::uint8_t>(y);
    const std::uint8_t* right = right_usable.empty() ? nullptr : right_usable.ptr<std::uint8_t>(y);
    float* d = disparity.ptr<float>(y);
    for (int x = 0; x < disparity.cols; ++x) {
      if (!std::isfinite(d[x])) continue;
      // rounded without a call: disparities lie above −kFar
      constexpr int kFar = 1 << 20;
      const int whole = static_cast<int>(static_cast<double>(d[x]) + kFar + 0.5) - kFar;
      const int partner = std::clamp(x - whole, 0, disparity.cols - 1);
      if ((left != nullptr && left[x] == 0) || (right != nullptr && right[partner] == 0)) d[x] = kInvalid;
    }
  });
}

// Blobs whose disparities hang together to one pixel and that are smaller than `area_px` are mismatches.
void RemoveBlobs(cv::Mat& disparity, DisparityRange range, int area_px) {
  if (area_px <= 0) return;
  constexpr int kSteps = 16;
  if (range.count * kSteps > std::numeric_limits<std::int16_t>::max()) {
    throw std::invalid_argument("matching: a range of more than 2047 disparities is not served");
  }
  constexpr std::int16_t kBlank = -kSteps;
  cv::Mat fixed(disparity.size(), CV_16SC1);
  for (int y = 0; y < disparity.rows; ++y) {
    for (int x = 0; x < disparity.cols; ++x) {
      const float d = disparity.at<float>(y, x);
      fixed.at<std::int16_t>(y, x) =
          std::isfinite(d) ? static_cast<std::int16_t>(std::lround(std::max(0.0f, d - range.min_px) * kSteps)) : kBlank;
    }
  }
  cv::filterSpeckles(fixed, kBlank, area_px, kSteps);
  disparity.setTo(kInvalid, fixed == kBlank);
}

}  // namespace

cv::Mat SearchDisparity(const GreyPair& pair, DisparityRange range, const StereoOptions& options,
                        const DisparityTiles* tiles, SearchBuffers& memory) {
  AggregateOptions aggregate;
  aggregate.p1 = options.p1;
  aggregate.p2 = options.p2;
  aggregate.census_bits = CensusBits(options.census_width, options.census_height);
  aggregate.uniqueness = options.uniqueness;
  aggregate.tiles = tiles;
  if (options.adaptive_p2) {
    aggregate.guide = &pair.left;
    aggregate.guide_scale = pair.levels_of_255;
  }
  CensusTransform(pair.left, options.census_width, options.census_height, memory.left_census);
  CensusTransform(pair.right, options.census_width, options.census_height, memory.right_census);
  FindWinners(memory.left_census, memory.right_census, range, aggregate, memory.aggregate, memory.winners);
  OwnDisparities(memory.winners, range, memory.left_disparity, memory.right_disparity);
  if (options.median_px > 0) {
    for (cv::Mat* disparity : {&memory.left_disparity, &memory.right_disparity}) {
      cv::medianBlur(*disparity, memory.filtered, options.median_px);
      cv::swap(*disparity, memory.filtered);
    }
  }
  cv::Mat disparity = CheckedDisparity(memory.left_disparity, memory.right_disparity, range, options.left_right_px);
  const cv::Mat flat = WithoutTexture(pair.left, options.census_width, options.census_height);
  if (!flat.empty()) disparity.setTo(kInvalid, flat);
  KeepUsable(disparity, pair.usable.left, pair.usable.right);
  RemoveBlobs(disparity, range, options.speckle_area_px);
  return disparity;
}

}  // namespace granary
