// Least-squares matching on grey values: the disparity to a few hundredths of a pixel, with its standard deviation.
#pragma once

#include <opencv2/core/mat.hpp>

namespace granary {

/// Standard deviation of a disparity that was not refined: census, path costs and the equiangular interpolant; see
/// docs/method.md.
inline constexpr float kUnrefinedDeviation_px = 0.3f;

struct RefineOptions {
  int radius_px = 6;          ///< half window, 1 … 15
  int iterations = 3;         ///< passes, at least 1
  double max_shift_px = 1.5;  ///< a pixel that wants to move further keeps its disparity
};

struct Refined {
  cv::Mat disparity_px;  ///< CV_32FC1, +inf invalid
  cv::Mat deviation_px;  ///< CV_32FC1, standard deviation from the window's own residuals; NaN invalid
};

/// Refines each valid disparity so that the left window and the right picture, warped by the disparities of the
/// window, agree up to a gain and an offset: `I_L = gain · I_R(x − D − δ) + offset`, solved for δ, gain and offset.
///
/// The right picture is warped by planes fitted to the disparities of each window before every pass, so the slopes of
/// the surface are part of the start value and δ is constant over the window; the passes together keep curvature that
/// one of them would flatten. A pixel whose window straddles a disparity step takes the plane and the shift of a window
/// beside it that lies on the pixel's own surface. One that the refinement would move too far, whose window's pictures
/// do not agree, or that finds no smooth window keeps its disparity and gets the deviation of an unrefined one, 0.3 px.
/// The result depends neither on the number of threads nor on the instruction set. Source: Grün 1985, least squares
/// correlation.
///
/// The deviation covers noise, also noise that a rectification has smeared over neighbours: it is scaled by how much
/// neighbouring residuals of this picture go together. It does not cover what all pixels share (calibration), relief
/// finer than the window, nor the bias of the interpolation, up to 0.002 px. It is never below 0.001 px.
/// @param left, right rectified grey, H×W, CV_32FC1
/// @param disparity_px CV_32FC1, +inf invalid
/// @param left_usable, right_usable CV_8UC1 or empty; where 0 (saturated, black, outside) the grey value says nothing
///   and is left out of every window
/// @throws std::invalid_argument for other types, sizes or options
[[nodiscard]] Refined RefineDisparity(const cv::Mat& left, const cv::Mat& right, const cv::Mat& disparity_px,
                                      const RefineOptions& options, const cv::Mat& left_usable = {},
                                      const cv::Mat& right_usable = {});

}  // namespace granary
