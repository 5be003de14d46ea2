// Rows are independent. A vector of pixels is compared with each neighbour in turn; eight comparisons make one byte of
// the word, which is written as a plane of its own, the way the Hamming distances are counted.
#include "pipeline/stereo/census.h"

#include <algorithm>
#include <stdexcept>
#include <vector>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "pipeline/stereo/path_kernels.h"

#ifndef GRANARY_CENSUS_WINDOW
#define GRANARY_CENSUS_WINDOW
namespace granary {

// A pixel's neighbours in the order of their bits, for the pixels of one row.
struct CensusNeighbour {
  const float* row;
  int dx;
};
struct CensusWindow {
  const float* centre = nullptr;
  std::vector<CensusNeighbour> neighbours;
  int width = 0;
};

}  // namespace granary
#endif

// Without HWY_WANT_AVX3_DL: Highway 1.0.3 truncates 32 bits to 8 wrongly there.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "pipeline/stereo/census.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace granary {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// One byte of the pixels x0 … x1 − 1: kBits neighbours of each, from `first` on.
template <int kBits>
void CompareRun(const CensusWindow& window, int first, int x0, int x1, std::uint8_t* out) {
  const hn::ScalableTag<float> df;
  const hn::RebindToUnsigned<decltype(df)> du;
  const hn::Rebind<std::uint8_t, decltype(df)> d8;
  const int lanes = static_cast<int>(hn::Lanes(df));
  const float* neighbours[kBits];
  for (int k = 0; k < kBits; ++k)
    neighbours[k] = window.neighbours[first + k].row + x0 + window.neighbours[first + k].dx;
  const float* centre = window.centre + x0;
  out += x0;
  for (int i = 0; i < x1 - x0; i += lanes) {
    i = std::min(i, x1 - x0 - lanes);  // the last vector overlaps the one before
    const auto here = hn::LoadU(df, centre + i);
    auto byte = hn::Zero(du);
#pragma GCC unroll 8
    for (int k = 0; k < kBits; ++k) {
      const auto brighter = hn::Gt(here, hn::LoadU(df, neighbours[k] + i));
      byte = hn::Or(byte, hn::IfThenElseZero(hn::RebindMask(du, brighter), hn::Set(du, 1u << k)));
    }
    hn::StoreU(hn::TruncateTo(d8, byte), d8, out + i);
  }
}

// The pixels x0 … x1 − 1, whose windows lie inside the rows; a vector of them at least.
void CensusRun(const CensusWindow& window, int x0, int x1, std::uint8_t* out) {
  const int bits = static_cast<int>(window.neighbours.size());
  for (int bit = 0; bit < bits; bit += 8, out += window.width) {
    // Windows of an odd number of pixels have an even number of neighbours.
    switch (std::min(8, bits - bit)) {
      case 8:
        CompareRun<8>(window, bit, x0, x1, out);
        break;
      case 6:
        CompareRun<6>(window, bit, x0, x1, out);
        break;
      case 4:
        CompareRun<4>(window, bit, x0, x1, out);
        break;
      default:
        CompareRun<2>(window, bit, x0, x1, out);
    }
  }
}

int CensusLanes() { return static_cast<int>(hn::Lanes(hn::ScalableTag<float>())); }

}  // namespace HWY_NAMESPACE
}  // namespace granary
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace granary {

HWY_EXPORT(CensusRun);
HWY_EXPORT(CensusLanes);

namespace {

// One pixel whose window may reach over the ends of the rows.
void CensusPixel(const CensusWindow& window, int x, std::uint8_t* out) {
  const int bits = static_cast<int>(window.neighbours.size());
  for (int bit = 0; bit < bits; bit += 8) {
    unsigned byte = 0;
    for (int k = bit; k < std::min(bits, bit + 8); ++k) {
      const CensusNeighbour& neighbour = window.neighbours[k];
      const float there = neighbour.row[std::clamp(x + neighbour.dx, 0, window.width - 1)];
      byte |= static_cast<unsigned>(window.centre[x] > there) << (k - bit);
    }
    out[static_cast<std::size_t>(bit / 8) * window.width + x] = static_cast<std::uint8_t>(byte);
  }
}

}  // namespace

void CensusTransform(const cv::Mat& grey, int window_width, int window_height, CensusImage& census) {
  if (grey.type() != CV_32FC1 || grey.empty()) {
    throw std::invalid_argument("census: the picture must be CV_32FC1 and not empty");
  }
  const int bits = CensusBits(window_width, window_height);
  if (window_width < 1 || window_height < 1 || window_width % 2 == 0 || window_height % 2 == 0 || bits < 1 ||
      bits > 62) {
    throw std::invalid_argument("census: the window must be odd and at most 9x7");
  }
  ChooseInstructionSet();
  const auto census_run = HWY_DYNAMIC_DISPATCH(CensusRun);
  const int rx = window_width / 2, ry = window_height / 2;
  const int width = grey.cols, height = grey.rows;
  // Columns whose windows lie inside the rows, when there are enough of them for a vector.
  const bool vectors = width - 2 * rx >= HWY_DYNAMIC_DISPATCH(CensusLanes)();
  const int inside_begin = vectors ? rx : width, inside_end = vectors ? width - rx : width;
  census.Resize(width, height, bits);
  tbb::parallel_for(tbb::blocked_range<int>(0, height, 16), [&](const tbb::blocked_range<int>& rows) {
    CensusWindow window;
    window.width = width;
    for (int y = rows.begin(); y < rows.end(); ++y) {
      window.centre = grey.ptr<float>(y);
      window.neighbours.clear();
      for (int dy = -ry; dy <= ry; ++dy) {
        const float* row = grey.ptr<float>(std::clamp(y + dy, 0, height - 1));
        for (int dx = -rx; dx <= rx; ++dx) {
          if (dx != 0 || dy != 0) window.neighbours.push_back({row, dx});
        }
      }
      std::uint8_t* out = census.Row(y);
      for (int x = 0; x < inside_begin; ++x) CensusPixel(window, x, out);
      if (vectors) census_run(window, inside_begin, inside_end, out);
      for (int x = inside_end; x < width; ++x) CensusPixel(window, x, out);
    }
  });
}

}  // namespace granary
#endif  // HWY_ONCE
