// The order of METHOD §3: census, path costs, winners, median, left–right check, and what is left out.
#include "pipeline/stereo/search.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <stdexcept>
#include <vector>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "pipeline/stereo/for_each_row.h"

namespace granary {

namespace {

constexpr float kInvalid = std::numeric_limits<float>::infinity();

// Disparities of either picture by its own winners, the left one's with its fraction; kNone where there is none.
constexpr float kNone = -1e6f;

void OwnRow(const Winners& winners, DisparityRange range, int y, float* left, float* right) {
  const std::int16_t* left_index = winners.left_index.ptr<std::int16_t>(y);
  const std::int16_t* right_index = winners.right_index.ptr<std::int16_t>(y);
  const float* offset = winners.subpixel.ptr<float>(y);
  const std::uint8_t* unique = winners.unique.ptr<std::uint8_t>(y);
  const float first = static_cast<float>(range.min_px);
  for (int x = 0; x < winners.left_index.cols; ++x) {
    const float value = first + static_cast<float>(left_index[x]) + offset[x];
    left[x] = left_index[x] >= 0 && unique[x] != 0 ? value : kNone;
    right[x] = right_index[x] >= 0 ? first + static_cast<float>(right_index[x]) : kNone;
  }
}

// A left disparity is kept when the right picture's own at its partner points back to it; a fractional disparity has a
// partner on either side. `out` may be `left`.
void CheckRow(const float* left, const float* right, DisparityRange range, int tolerance_px, int width, float* out) {
  const float limit = static_cast<float>(tolerance_px), first = static_cast<float>(range.min_px);
  for (int x = 0; x < width; ++x) {
    const float d = left[x];
    out[x] = kInvalid;
    if (d == kNone) continue;
    // rounded; a disparity is never more than half a pixel below the least one
    const float whole = static_cast<float>(range.min_px + static_cast<int>(d - first + 0.5f));
    const int partner = std::clamp(x - static_cast<int>(whole), 0, width - 1);
    const int between = std::clamp(partner + (d > whole ? -1 : 1), 0, width - 1);
    if (std::abs(right[partner] - whole) <= limit || std::abs(right[between] - whole) <= limit) out[x] = d;
  }
}

cv::Mat CheckedDisparity(const Winners& winners, DisparityRange range, const StereoOptions& options,
                         SearchBuffers& memory) {
  const cv::Size size = winners.left_index.size();
  cv::Mat disparity(size, CV_32FC1);
  if (options.median_px == 0) {
    ForEachRow(size.height, [&](int y) {
      std::vector<float> right(size.width);
      float* row = disparity.ptr<float>(y);
      OwnRow(winners, range, y, row, right.data());
      CheckRow(row, right.data(), range, options.left_right_px, size.width, row);
    });
    return disparity;
  }
  memory.left_disparity.create(size, CV_32FC1);
  memory.right_disparity.create(size, CV_32FC1);
  ForEachRow(size.height, [&](int y) {
    OwnRow(winners, range, y, memory.left_disparity.ptr<float>(y), memory.right_disparity.ptr<float>(y));
  });
  for (cv::Mat* own : {&memory.left_disparity, &memory.right_disparity}) {
    cv::medianBlur(*own, memory.filtered, options.median_px);
    cv::swap(*own, memory.filtered);
  }
  ForEachRow(size.height, [&](int y) {
    CheckRow(memory.left_disparity.ptr<float>(y), memory.right_disparity.ptr<float>(y), range, options.left_right_px,
             size.width, disparity.ptr<float>(y));
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
  cv::Mat disparity = CheckedDisparity(memory.winners, range, options, memory);
  const cv::Mat flat = WithoutTexture(pair.left, options.census_width, options.census_height);
  if (!flat.empty()) disparity.setTo(kInvalid, flat);
  KeepUsable(disparity, pair.usable.left, pair.usable.right);
  RemoveBlobs(disparity, range, options.speckle_area_px);
  return disparity;
}

}  // namespace granary
