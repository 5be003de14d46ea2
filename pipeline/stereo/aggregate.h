// Semi-global aggregation of census costs: the sums S(p, d) over eight path directions.
#pragma once

#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "pipeline/stereo/census.h"

namespace granary {

/// Disparities min_px … min_px + count − 1; `x_right = x_left − disparity`.
struct DisparityRange {
  int min_px = 0;
  int count = 0;
};

struct AggregateOptions {
  int p1 = 6;
  int p2 = 40;
  int census_bits = 62;
  const cv::Mat* guide = nullptr;  ///< CV_32FC1; when set, P2 adapts to its gradient: max(P1 + 1, P2 / |∂I|)
  double guide_scale = 1.0;        ///< grey levels (of 255) per unit of `guide`
};

/// S(p, d) for every pixel and disparity, disparity fastest. Slots beyond `count` are padding and never hold the least.
struct CostSums {
  int width = 0, height = 0, count = 0, stride = 0;
  std::vector<std::uint16_t> sums;
  [[nodiscard]] std::uint16_t* At(int y, int x) {
    return sums.data() + (static_cast<std::size_t>(y) * width + x) * stride;
  }
  [[nodiscard]] const std::uint16_t* At(int y, int x) const {
    return sums.data() + (static_cast<std::size_t>(y) * width + x) * stride;
  }
};

/// `S(p,d) = Σ_r L_r(p,d)` over eight directions with
/// `L_r(p,d) = C(p,d) + min(L_r(p−r,d), L_r(p−r,d±1) + P1, min L_r(p−r) + P2) − min L_r(p−r)`,
/// `C` the Hamming distance of the census words, its maximum where the right pixel lies outside the picture.
///
/// The result does not depend on the number of threads or the instruction set. Source: Zhao 2023, §4 (METHOD §3).
/// @throws std::invalid_argument for pictures of different size or an empty range
[[nodiscard]] CostSums AggregateCosts(const CensusImage& left, const CensusImage& right, DisparityRange range,
                                      const AggregateOptions& options);

/// Best disparity index of every left pixel, and the same for every right pixel, from the sums.
struct Winners {
  cv::Mat left_index;   ///< CV_16SC1, 0 … count − 1, −1 where no right pixel exists for any disparity
  cv::Mat right_index;  ///< CV_16SC1, for right pixels, −1 likewise
  cv::Mat subpixel;     ///< CV_32FC1, equiangular offset to add to left_index, −0.5 … 0.5
  cv::Mat unique;       ///< CV_8UC1, 255 where the second-best sum, ±1 aside, exceeds the best by the given share
};

/// Winner takes all, with the equiangular interpolant (Shimizu and Okutomi 2001) between whole disparities.
[[nodiscard]] Winners TakeWinners(const CostSums& sums, DisparityRange range, double uniqueness);

}  // namespace granary
