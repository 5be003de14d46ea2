// Several shots of one scene into one: disparities averaged, what moved in between noticed.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>

namespace granary {

struct FusedDisparities {
  cv::Mat disparity_px;  ///< CV_32FC1, +inf invalid
  cv::Mat deviation_px;  ///< CV_32FC1, standard deviation of the mean, NaN invalid
  cv::Mat moved;         ///< CV_8UC1, 255 where the shots saw different surfaces, over more than a few pixels
};

/// A pixel is the mean of the shots that saw it, if more than half of them did and all that did agree.
/// @param disparities one a shot, H×W, CV_32FC1, +inf invalid; at least one
/// @param deviations as many, H×W, CV_32FC1
/// @throws std::invalid_argument when there is none, or sizes or numbers differ
[[nodiscard]] FusedDisparities FuseDisparities(const std::vector<cv::Mat>& disparities,
                                               const std::vector<cv::Mat>& deviations);

/// Relative standard deviation, %; NaN for fewer than two values or a mean that is not above 0.
[[nodiscard]] double RelativeDeviation_percent(const std::vector<double>& values);
/// Standard deviation; NaN for fewer than two values.
[[nodiscard]] double StandardDeviation(const std::vector<double>& values);

}  // namespace granary
