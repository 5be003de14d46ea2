// Rows are independent. A row is compared with each shifted neighbour row in turn, so that the inner loop is a plain
// run over contiguous floats that any compiler vectorises; bits gather in two 32-bit words a pixel.
#include "pipeline/stereo/census.h"

#include <algorithm>
#include <stdexcept>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <opencv2/imgproc.hpp>

namespace granary {

namespace {

void AppendBits(const float* centre, const float* neighbour, int width, int bit, std::uint32_t* bits) {
  for (int x = 0; x < width; ++x) bits[x] |= static_cast<std::uint32_t>(centre[x] > neighbour[x]) << bit;
}

}  // namespace

CensusImage CensusTransform(const cv::Mat& grey, int window_width, int window_height) {
  if (grey.type() != CV_32FC1) throw std::invalid_argument("census: the picture must be CV_32FC1");
  if (window_width < 1 || window_height < 1 || window_width % 2 == 0 || window_height % 2 == 0 ||
      CensusBits(window_width, window_height) > 62) {
    throw std::invalid_argument("census: the window must be odd and at most 9x7");
  }
  const int rx = window_width / 2, ry = window_height / 2;
  const int width = grey.cols, height = grey.rows;
  cv::Mat padded;
  cv::copyMakeBorder(grey, padded, ry, ry, rx, rx, cv::BORDER_REPLICATE);

  CensusImage census{width, height, std::vector<std::uint64_t>(static_cast<std::size_t>(width) * height)};
  tbb::parallel_for(tbb::blocked_range<int>(0, height, 16), [&](const tbb::blocked_range<int>& rows) {
    std::vector<std::uint32_t> low(width), high(width);
    for (int y = rows.begin(); y < rows.end(); ++y) {
      std::fill(low.begin(), low.end(), 0u);
      std::fill(high.begin(), high.end(), 0u);
      const float* centre = padded.ptr<float>(y + ry) + rx;
      int bit = 0;
      for (int dy = -ry; dy <= ry; ++dy) {
        for (int dx = -rx; dx <= rx; ++dx) {
          if (dx == 0 && dy == 0) continue;
          const float* neighbour = padded.ptr<float>(y + ry + dy) + rx + dx;
          AppendBits(centre, neighbour, width, bit % 31, bit < 31 ? low.data() : high.data());
          ++bit;
        }
      }
      std::uint64_t* out = census.words.data() + static_cast<std::size_t>(y) * width;
      for (int x = 0; x < width; ++x) out[x] = static_cast<std::uint64_t>(high[x]) << 31 | low[x];
    }
  });
  return census;
}

}  // namespace granary
