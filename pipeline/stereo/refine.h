// Least-squares matching on grey values: the disparity to a few hundredths of a pixel, with its standard deviation.
#pragma once

#include <opencv2/core/mat.hpp>

namespace granary {

struct RefineOptions {
  int radius_px = 5;  ///< half window
  int iterations = 2;
  double max_shift_px = 1;  ///< a pixel that wants to move further keeps its disparity
};

struct Refined {
  cv::Mat disparity_px;  ///< CV_32FC1, +inf invalid
  cv::Mat deviation_px;  ///< CV_32FC1, standard deviation from the window's own residuals; NaN invalid
};

/// Refines each valid disparity so that the left window and the right picture, warped by the disparities of the
/// window, agree up to a gain and an offset: `I_L = gain · I_R(x − D − δ) + offset`, solved for δ, gain and offset.
///
/// Because the right picture is warped by the disparity of each pixel, smoothed over a window before every pass, the
/// slope of the surface is part of the start value and δ is constant over the window. A pixel near a disparity step, or
/// one that the refinement would move too far or worsen, keeps its disparity and gets the deviation of an unrefined
/// one, 0.3 px. The result does not depend on the number of threads. Source: Grün 1985, least squares correlation.
/// @param left, right rectified grey, H×W, CV_32FC1
/// @param disparity_px CV_32FC1, +inf invalid
[[nodiscard]] Refined RefineDisparity(const cv::Mat& left, const cv::Mat& right, const cv::Mat& disparity_px,
                                      const RefineOptions& options);

}  // namespace granary
