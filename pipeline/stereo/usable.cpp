// Plain neighbourhood filters of OpenCV.
#include "pipeline/stereo/usable.h"

#include <opencv2/imgproc.hpp>

namespace granary {

cv::Mat SaturatedAreas(const cv::Mat& full) {
  // A corner pixel of a square patch sees the patch in (5/9)² = 0.31 of its neighbourhood.
  constexpr double kPatch = 0.25 * 255, kMostly = 0.5 * 255;
  cv::Mat share;
  cv::boxFilter(full, share, CV_32F, {9, 9});
  return (full & (share > kPatch)) | (share > kMostly);
}

cv::Mat WithoutTexture(const cv::Mat& grey, int window_width, int window_height) {
  constexpr double kRounding = 1e-3;  // of a remap
  const cv::Mat window = cv::Mat::ones(window_height, window_width, CV_8UC1);
  cv::Mat least, greatest;
  cv::erode(grey, least, window);
  cv::dilate(grey, greatest, window);
  return greatest - least < kRounding;
}

}  // namespace granary
