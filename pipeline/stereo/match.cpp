// The order of METHOD §3 on one page: census, sums, winners, left–right check, uniqueness, blobs, refinement.
#include "pipeline/stereo/match.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <stdexcept>
#include <string>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "pipeline/stereo/census.h"
#include "pipeline/stereo/refine.h"

namespace granary {

namespace {

constexpr float kInvalid = std::numeric_limits<float>::infinity();

cv::Mat ToFloat(const cv::Mat& grey, const char* side) {
  if (grey.empty()) throw std::invalid_argument(std::string("matching: the ") + side + " picture is empty");
  if (grey.type() != CV_8UC1 && grey.type() != CV_16UC1 && grey.type() != CV_32FC1) {
    throw std::invalid_argument(std::string("matching: the ") + side +
                                " picture must have one channel of 8 or 16 bits, or float");
  }
  cv::Mat out;
  grey.convertTo(out, CV_32FC1);
  return out;
}

// A left winner is kept when the right picture's winner at its partner points back to it; a fractional disparity has
// a partner on either side.
cv::Mat CheckedDisparity(const Winners& winners, DisparityRange range, const StereoOptions& options) {
  cv::Mat disparity(winners.left_index.size(), CV_32FC1, cv::Scalar(kInvalid));
  for (int y = 0; y < disparity.rows; ++y) {
    const std::int16_t* left = winners.left_index.ptr<std::int16_t>(y);
    const std::int16_t* right = winners.right_index.ptr<std::int16_t>(y);
    const float* offset = winners.subpixel.ptr<float>(y);
    const std::uint8_t* unique = winners.unique.ptr<std::uint8_t>(y);
    float* out = disparity.ptr<float>(y);
    for (int x = 0; x < disparity.cols; ++x) {
      if (left[x] < 0 || unique[x] == 0) continue;
      const int partner = x - (range.min_px + left[x]);
      const int between = std::clamp(partner + (offset[x] > 0 ? -1 : 1), 0, disparity.cols - 1);
      const auto agrees = [&](int column) { return std::abs(right[column] - left[x]) <= options.left_right_px; };
      if (!agrees(partner) && !agrees(between)) continue;
      out[x] = static_cast<float>(range.min_px + left[x]) + offset[x];
    }
  }
  return disparity;
}

// 255 where every pixel of the census window is the same, saturated or black: there is nothing to compare, and the
// paths would carry a neighbour's disparity, or the least one, into it. The limit leaves room for the rounding of a
// remap.
cv::Mat WithoutTexture(const cv::Mat& grey, int window_width, int window_height) {
  const cv::Mat window = cv::Mat::ones(window_height, window_width, CV_8UC1);
  cv::Mat least, greatest;
  cv::erode(grey, least, window);
  cv::dilate(grey, greatest, window);
  return greatest - least < 1e-3;
}

// Blobs whose disparities hang together to one pixel and that are smaller than `area_px` are mismatches.
void RemoveBlobs(cv::Mat& disparity, DisparityRange range, int area_px) {
  if (area_px <= 0) return;
  constexpr int kSteps = 16;
  if (range.count * kSteps > std::numeric_limits<std::int16_t>::max()) {
    throw std::invalid_argument("matching: a range of more than 2047 disparities is not served");
  }
  constexpr std::int16_t kNone = -kSteps;
  cv::Mat fixed(disparity.size(), CV_16SC1);
  for (int y = 0; y < disparity.rows; ++y) {
    for (int x = 0; x < disparity.cols; ++x) {
      const float d = disparity.at<float>(y, x);
      fixed.at<std::int16_t>(y, x) =
          std::isfinite(d) ? static_cast<std::int16_t>(std::lround(std::max(0.0f, d - range.min_px) * kSteps)) : kNone;
    }
  }
  cv::filterSpeckles(fixed, kNone, area_px, kSteps);
  disparity.setTo(kInvalid, fixed == kNone);
}

}  // namespace

StereoResult MatchStereo(const cv::Mat& left, const cv::Mat& right, DisparityRange range, const StereoOptions& options,
                         const cv::Mat& valid, MatchBuffers* buffers) {
  if (left.size() != right.size()) throw std::invalid_argument("matching: the pictures differ in size");
  if (left.type() != right.type()) throw std::invalid_argument("matching: the pictures differ in depth or channels");
  if (range.count < 1) throw std::invalid_argument("matching: the number of disparities must be at least 1");
  if (range.min_px >= left.cols || range.min_px + range.count <= -left.cols) {
    throw std::invalid_argument("matching: disparities " + std::to_string(range.min_px) + " to " +
                                std::to_string(range.min_px + range.count - 1) + " leave no overlap in a picture " +
                                std::to_string(left.cols) + " px wide");
  }
  const cv::Mat left_grey = ToFloat(left, "left"), right_grey = ToFloat(right, "right");
  const int bits = CensusBits(options.census_width, options.census_height);
  AggregateOptions aggregate;
  aggregate.p1 = options.p1;
  aggregate.p2 = options.p2;
  aggregate.census_bits = bits;
  if (options.adaptive_p2) {
    aggregate.guide = &left_grey;
    aggregate.guide_scale = left.type() == CV_16UC1 ? 1.0 / 257 : 1.0;
  }
  aggregate.uniqueness = options.uniqueness;
  MatchBuffers own;
  MatchBuffers& memory = buffers == nullptr ? own : *buffers;
  CensusTransform(left_grey, options.census_width, options.census_height, memory.left_census);
  CensusTransform(right_grey, options.census_width, options.census_height, memory.right_census);
  FindWinners(memory.left_census, memory.right_census, range, aggregate, memory.aggregate, memory.winners);
  cv::Mat disparity = CheckedDisparity(memory.winners, range, options);
  disparity.setTo(kInvalid, WithoutTexture(left_grey, options.census_width, options.census_height));
  if (!valid.empty()) disparity.setTo(kInvalid, valid == 0);
  RemoveBlobs(disparity, range, options.speckle_area_px);
  if (options.refine_radius_px == 0) {
    cv::Mat deviation(disparity.size(), CV_32FC1, cv::Scalar(0.3));
    deviation.setTo(std::numeric_limits<float>::quiet_NaN(), disparity == kInvalid);
    return {disparity, deviation};
  }
  const Refined refined = RefineDisparity(left_grey, right_grey, disparity, {.radius_px = options.refine_radius_px});
  return {refined.disparity_px, refined.deviation_px};
}

}  // namespace granary
