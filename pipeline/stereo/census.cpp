// Rows are independent. A vector of pixels is compared with each neighbour in turn; eight comparisons make one byte of
// the word, which is written as a plane of its own, the way the Hamming distances are counted.
#include "pipeline/stereo/census.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <vector>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "pipeline/stereo/path_kernels.h"

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

// Bytes of `width` pixels. `neighbours` has one pointer a bit, to what is compared with the first pixel; all rows may
// be read up to a vector past their end, `out` is written up to `width`.
void CensusRow(const float* centre, const float* const* neighbours, int bits, int width, std::uint8_t* out) {
  const hn::ScalableTag<float> df;
  const hn::RebindToUnsigned<decltype(df)> du;
  const hn::Rebind<std::uint8_t, decltype(df)> d8;
  const int lanes = static_cast<int>(hn::Lanes(df));
  HWY_ALIGN std::uint8_t rest[HWY_MAX_BYTES];
  for (int x = 0; x < width; x += lanes) {
    const auto here = hn::LoadU(df, centre + x);
    for (int bit = 0; bit < bits; bit += 8) {
      auto byte = hn::Zero(du);
      const int end = std::min(bits, bit + 8);
      for (int k = bit; k < end; ++k) {
        const auto brighter = hn::RebindMask(du, hn::Gt(here, hn::LoadU(df, neighbours[k] + x)));
        byte = hn::Or(byte, hn::IfThenElseZero(brighter, hn::Set(du, 1u << (k - bit))));
      }
      std::uint8_t* to = out + static_cast<std::size_t>(bit / 8) * width + x;
      if (x + lanes <= width) {
        hn::StoreU(hn::TruncateTo(d8, byte), d8, to);
      } else {
        hn::StoreU(hn::TruncateTo(d8, byte), d8, rest);
        std::memcpy(to, rest, width - x);
      }
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace granary
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace granary {

HWY_EXPORT(CensusRow);

namespace {

constexpr int kRowsPerTask = 32;

// A row of `grey` with `margin` copies of its outer pixels at either end and room to read past them.
void PadRow(const float* grey, int width, int margin, float* padded) {
  std::fill(padded, padded + margin, grey[0]);
  std::copy(grey, grey + width, padded + margin);
  std::fill(padded + margin + width, padded + 2 * margin + width + kLaneMultiple, grey[width - 1]);
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
  const auto census_row = HWY_DYNAMIC_DISPATCH(CensusRow);
  const int rx = window_width / 2, ry = window_height / 2;
  const int width = grey.cols, height = grey.rows;
  census.Resize(width, height, bits);
  tbb::parallel_for(0, (height + kRowsPerTask - 1) / kRowsPerTask, [&](int task) {
    const int begin = task * kRowsPerTask, end = std::min(height, begin + kRowsPerTask);
    const std::size_t padded_width = static_cast<std::size_t>(width) + 2 * rx + kLaneMultiple;
    std::vector<float> padded(padded_width * (end - begin + 2 * ry));
    for (int y = begin - ry; y < end + ry; ++y) {
      PadRow(grey.ptr<float>(std::clamp(y, 0, height - 1)), width, rx, padded.data() + (y - begin + ry) * padded_width);
    }
    std::vector<const float*> neighbours;
    for (int y = begin; y < end; ++y) {
      neighbours.clear();
      const float* corner = padded.data() + (y - begin) * padded_width;
      for (int dy = 0; dy < window_height; ++dy) {
        for (int dx = 0; dx < window_width; ++dx) {
          if (dx != rx || dy != ry) neighbours.push_back(corner + dy * padded_width + dx);
        }
      }
      census_row(corner + ry * padded_width + rx, neighbours.data(), bits, width, census.Row(y));
    }
  });
}

}  // namespace granary
#endif  // HWY_ONCE
