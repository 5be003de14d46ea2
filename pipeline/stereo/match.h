// Dense stereo on a rectified pair: census, semi-global matching, checks, refinement (METHOD §3).
#pragma once

#include <opencv2/core/mat.hpp>

#include "pipeline/options.h"
#include "pipeline/stereo/search.h"

namespace granary {

struct StereoResult {
  cv::Mat disparity_px;  ///< H×W, CV_32FC1, +inf invalid
  cv::Mat deviation_px;  ///< H×W, CV_32FC1, standard deviation, NaN invalid
};

/// Memory for pictures of one size, kept from one call to the next by whoever calls often.
struct MatchBuffers {
  GreyPair pair;
  SearchBuffers search;
};

/// Disparity of every left pixel, `x_right = x_left − disparity`.
///
/// @param left, right rectified grey, one size, 8- or 16-bit or CV_32FC1 and finite
/// @param range disparities searched, at most 2047
/// @param usable a pixel whose mask is 0, or whose partner's is, is invalid in the result; saturated areas of 8- and
///   16-bit pictures are so without a mask
/// @param buffers memory to use again; null allocates and gives it back
/// @throws std::invalid_argument for pictures of different size or type, of more than one channel or with grey levels
///   that are not finite, masks that do not fit, a range of none or more than 2047 disparities or without overlap, and
///   options with faults
[[nodiscard]] StereoResult MatchStereo(const cv::Mat& left, const cv::Mat& right, DisparityRange range,
                                       const StereoOptions& options, const UsablePixels& usable = {},
                                       MatchBuffers* buffers = nullptr);

}  // namespace granary
