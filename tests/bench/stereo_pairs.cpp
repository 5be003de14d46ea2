// The left picture is the dots themselves; the right one shows the dot its ray meets first, found by following the
// surface from the nearest disparity to the farthest.
#include "tests/bench/stereo_pairs.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <random>

#include <tbb/parallel_for.h>

#include "tests/pipeline/speckle.h"

namespace granary {

namespace {

constexpr float kHidden = std::numeric_limits<float>::infinity();

// The left column that the right pixel (x, y) shows; none where its ray ends on the wall of a step.
std::optional<double> LeftColumn(const StereoSurface& surface, double x, double y) {
  const auto ahead = [&](double u) { return u - x - surface.disparity_px(u, y); };  // > 0: the ray is still in front
  if (!surface.steps) {
    double u = x + 0.5 * (surface.least_px + surface.most_px);
    for (int i = 0; i < 60; ++i) {
      const double before = u;
      u = x + surface.disparity_px(u, y);
      if (std::abs(u - before) < 1e-7) break;
    }
    return u;
  }
  constexpr double kStride_px = 0.5;
  double near = x + surface.most_px + 1e-9;
  while (near > x + surface.least_px - 1) {
    double far = near - kStride_px;
    if (ahead(far) > 0) {
      near = far;
      continue;
    }
    for (int i = 0; i < 40; ++i) {
      const double middle = 0.5 * (near + far);
      (ahead(middle) > 0 ? near : far) = middle;
    }
    if (std::abs(ahead(far)) > 1e-3) return std::nullopt;
    return far;
  }
  return std::nullopt;
}

template <typename Grey>
void RenderRow(cv::Mat& picture, int y, double noise, unsigned seed, Grey grey) {
  std::mt19937 random(seed + 7919u * static_cast<unsigned>(y));
  std::normal_distribution<double> normal(0, 1);
  for (int x = 0; x < picture.cols; ++x) {
    picture.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(grey(x) + noise * normal(random));
  }
}

}  // namespace

RenderedPair RenderPair(cv::Size size, const StereoSurface& surface, const RenderOptions& options) {
  // The right camera sees past the left picture's right edge.
  const cv::Size reach(size.width + static_cast<int>(std::ceil(surface.most_px)) + 1, size.height);
  const Speckle dots(reach, options.seed), wall(reach, options.seed + 1);
  RenderedPair pair{cv::Mat(size, CV_8UC1), cv::Mat(size, CV_8UC1), cv::Mat(size, CV_32FC1)};
  tbb::parallel_for(0, size.height, [&](int y) {
    RenderRow(pair.left, y, options.noise, options.seed + 1000, [&](int x) { return dots.At(x, y); });
    RenderRow(pair.right, y, options.noise, options.seed + 2000, [&](int x) {
      const auto u = LeftColumn(surface, x, y);
      return options.gain * (u ? dots.At(*u, y) : wall.At(x, y));
    });
    for (int x = 0; x < size.width; ++x) {
      const double truth = surface.disparity_px(x, y), right = x - truth;
      bool seen = right >= 0 && right <= size.width - 1;
      if (seen && surface.steps) {
        const auto u = LeftColumn(surface, right, y);
        seen = u && std::abs(*u - x) < 0.01;
      }
      pair.truth_px.at<float>(y, x) = seen ? static_cast<float>(truth) : kHidden;
    }
  });
  return pair;
}

StereoSurface CurvedSurface(cv::Size size, int disparities) {
  const double least = 0.05 * disparities, most = 0.9 * disparities;
  return {[=](double x, double y) {
            const double u = x / size.width, v = y / size.height;
            const double share = 0.15 + 0.45 * u + 0.25 * v + 0.1 * std::sin(2 * std::numbers::pi * (u + v));
            return least + (most - least) * std::clamp(share, 0.0, 1.0);
          },
          least, most, false};
}

OpenCVPeer::OpenCVPeer(OpenCVMatcher matcher, DisparityRange range) : range_(range) {
  if (matcher == OpenCVMatcher::kBlock) {
    const auto block = cv::StereoBM::create(range.count, 9);
    block->setMinDisparity(range.min_px);
    block->setDisp12MaxDiff(1);
    block->setUniquenessRatio(5);
    block->setSpeckleWindowSize(100);
    block->setSpeckleRange(1);
    matcher_ = block;
    return;
  }
  const int mode = matcher == OpenCVMatcher::kHH ? cv::StereoSGBM::MODE_HH : cv::StereoSGBM::MODE_SGBM_3WAY;
  matcher_ = cv::StereoSGBM::create(range.min_px, range.count, 3, 8 * 9, 32 * 9, 1, 0, 5, 100, 1, mode);
}

void OpenCVPeer::Match(const cv::Mat& left, const cv::Mat& right, cv::Mat& fixed) const {
  matcher_->compute(left, right, fixed);
}

cv::Mat OpenCVPeer::Disparity_px(const cv::Mat& left, const cv::Mat& right) const {
  cv::Mat fixed, disparity;
  Match(left, right, fixed);
  fixed.convertTo(disparity, CV_32FC1, 1.0 / 16);
  disparity.setTo(kHidden, fixed < range_.min_px * 16);
  return disparity;
}

}  // namespace granary
