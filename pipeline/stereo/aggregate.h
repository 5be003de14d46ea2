// Semi-global matching on census words: the disparity of least summed path cost over eight directions.
#pragma once

#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "pipeline/stereo/census.h"
#include "pipeline/stereo/raw_array.h"

namespace granary {

/// Disparities min_px … min_px + count − 1; `x_right = x_left − disparity`.
struct DisparityRange {
  int min_px = 0;
  int count = 0;
};

/// Where to search, tile by tile: each kTile_px square of the left picture has `count` disparities, from index
/// `first` of the range on.
struct DisparityTiles {
  static constexpr int kTile_px = 32;
  int count = 0;  ///< a multiple of 64
  cv::Mat first;  ///< CV_32SC1, a value a tile, 0 … range.count − count
};

struct AggregateOptions {
  int p1 = 6;
  int p2 = 40;
  int census_bits = 62;
  const cv::Mat* guide =
      nullptr;               ///< CV_32FC1; when set, P2 falls with its gradient: max(P1 + 1, min(P2, 20·P2 / |∂I|))
  double guide_scale = 1.0;  ///< grey levels (of 255) per unit of `guide`
  double uniqueness = 0;     ///< share by which every sum but the winner's neighbours must exceed the winner
  const DisparityTiles* tiles =
      nullptr;  ///< when set, a pixel has the disparities of its tile only, as if others cost without limit
  /// Most memory for the sums of the first four paths, bytes; pictures that need more are done in bands, each of whose
  /// first four paths are followed twice. The result is the same.
  std::size_t sums_budget = std::size_t{700} << 20;
};

/// The best disparity index of every pixel of either picture.
struct Winners {
  cv::Mat left_index;   ///< CV_16SC1, 0 … count − 1, −1 where no right pixel exists for any disparity
  cv::Mat right_index;  ///< CV_16SC1, for right pixels, −1 likewise
  cv::Mat subpixel;     ///< CV_32FC1, equiangular offset to add to left_index, −0.5 … 0.5
  cv::Mat unique;       ///< CV_8UC1, 255 where no sum but the winner's and its neighbours' comes near the winner's
};

/// What aggregation writes in between, for the next picture of the same size.
struct AggregateBuffers {
  RawArray<std::uint8_t> sums, paths;
};

/// Winner takes all over `S(p,d) = Σ_r L_r(p,d)`, eight directions, with
/// `L_r(p,d) = C(p,d) + min(L_r(p−r,d), L_r(p−r,d±1) + P1, min L_r(p−r) + P2) − min L_r(p−r)`,
/// `C` the Hamming distance of the census words, its maximum where the right pixel lies outside the picture; of equal
/// sums the least disparity. Between whole disparities the equiangular interpolant (Shimizu and Okutomi 2001).
///
/// The result depends neither on the number of threads nor on the instruction set. Source: Zhao 2023, §4 (METHOD §3).
/// @throws std::invalid_argument for pictures of different size, an empty range, or penalties or tiles that do not fit
/// @param winners the result; Mats of the right size are written over
void FindWinners(const CensusImage& left, const CensusImage& right, DisparityRange range,
                 const AggregateOptions& options, AggregateBuffers& buffers, Winners& winners);

}  // namespace granary
