// Neighbourhood filters; most pictures have not one flat pixel, and then there is nothing to filter.
#include "pipeline/stereo/usable.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <opencv2/imgproc.hpp>

namespace granary {

cv::Mat SaturatedAreas(const cv::Mat& full) {
  // Of 81 pixels; a corner pixel of a square patch sees 25 of the patch.
  constexpr int kSide = 9, kPatch = 20, kMostly = 40;
  cv::Mat count;
  cv::boxFilter(full & 1, count, CV_8U, {kSide, kSide}, {-1, -1}, false);
  return (full & (count > kPatch)) | (count > kMostly);
}

cv::Mat WithoutTexture(const cv::Mat& grey, int window_width, int window_height) {
  constexpr float kRounding = 1e-4f;  // of a remap, grey levels
  // 255 where a pixel equals the next one of its row, or of its column.
  cv::Mat as_next(grey.size(), CV_8UC1), as_below(grey.size(), CV_8UC1);
  std::atomic<bool> any{grey.rows == 1 || grey.cols == 1};
  tbb::parallel_for(tbb::blocked_range<int>(0, grey.rows, 16), [&](const tbb::blocked_range<int>& rows) {
    unsigned seen = 0;
    for (int y = rows.begin(); y < rows.end(); ++y) {
      const float* here = grey.ptr<float>(y);
      const float* below = grey.ptr<float>(std::min(y + 1, grey.rows - 1));
      std::uint8_t* next_out = as_next.ptr<std::uint8_t>(y);
      std::uint8_t* below_out = as_below.ptr<std::uint8_t>(y);
      for (int x = 0; x < grey.cols; ++x) below_out[x] = std::abs(here[x] - below[x]) < kRounding ? 255 : 0;
      for (int x = 0; x + 1 < grey.cols; ++x) next_out[x] = std::abs(here[x] - here[x + 1]) < kRounding ? 255 : 0;
      next_out[grey.cols - 1] = 255;
      // The last row and column have no next one.
      for (int x = 0; x + 1 < grey.cols && y + 1 < grey.rows; ++x) seen |= next_out[x] & below_out[x];
    }
    if (seen != 0) any = true;
  });
  if (!any) return {};
  // A window is all the same when every pair of neighbours in it is; outside the picture nothing speaks against it.
  const cv::Point centre(window_width / 2, window_height / 2);
  cv::erode(as_next, as_next, cv::Mat::ones(window_height, window_width - 1, CV_8UC1), centre);
  cv::erode(as_below, as_below, cv::Mat::ones(window_height - 1, window_width, CV_8UC1), centre);
  return as_next & as_below;
}

}  // namespace granary
