// Speckle pairs of any surface with the truth of every pixel, and the matchers that are held against one another.
#pragma once

#include <functional>

#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "pipeline/stereo/aggregate.h"

namespace granary {

/// What both cameras look at: the disparity at each place of the left picture.
struct StereoSurface {
  std::function<double(double x, double y)> disparity_px;
  double least_px = 0, most_px = 0;  ///< between which all of them lie
  bool steps = false;                ///< jumps: parts hide others from the right camera
};

struct RenderOptions {
  double noise = 2;  ///< standard deviation, grey levels
  double gain = 1;   ///< of the right camera
  unsigned seed = 1;
};

struct RenderedPair {
  cv::Mat left, right;  ///< CV_8UC1
  cv::Mat truth_px;     ///< CV_32FC1; +inf where the right picture does not show the left pixel
};

/// Dots evaluated where each camera looks; nothing is resampled. Rows are rendered in parallel, each with its own
/// noise.
[[nodiscard]] RenderedPair RenderPair(cv::Size size, const StereoSurface& surface, const RenderOptions& options);

/// A slanted and gently curved surface that uses most of `disparities`.
[[nodiscard]] StereoSurface CurvedSurface(cv::Size size, int disparities);

enum class OpenCVMatcher { kHH, k3Way, kBlock };

/// OpenCV's matcher with the settings its documentation suggests: blocks of 3×3, P1 = 8·n², P2 = 32·n², left–right
/// check 1, uniqueness 5 %, blobs below 100; StereoBM has blocks of 9×9.
class OpenCVPeer {
 public:
  OpenCVPeer(OpenCVMatcher matcher, DisparityRange range);
  /// CV_16SC1 in 1/16 px. @throws cv::Exception where its buffers would pass 2 GiB
  void Match(const cv::Mat& left, const cv::Mat& right, cv::Mat& fixed) const;
  /// CV_32FC1, +inf invalid.
  [[nodiscard]] cv::Mat Disparity_px(const cv::Mat& left, const cv::Mat& right) const;

 private:
  cv::Ptr<cv::StereoMatcher> matcher_;
  DisparityRange range_;
};

}  // namespace granary
