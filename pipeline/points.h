// Disparities to points in the world frame.
#pragma once

#include <opencv2/core/mat.hpp>

#include "pipeline/rectify.h"
#include "pipeline/types/transform.h"

namespace granary {

/// `Z = f·T / ((x_l − x_r) − (D_l − D_r))`, `X = Z·x/f`, `Y = Z·y/f`, then `P_world = T_world_left · P_left`.
/// Source: Zhao 2023, §3.4 (METHOD §4).
/// @param disparity_px H×W, CV_32FC1, +inf invalid
/// @return H×W, CV_32FC3, metres, NaN where the disparity is invalid or lies at or behind infinity
[[nodiscard]] cv::Mat PointsInWorld(const cv::Mat& disparity_px, const Rectification& rectification,
                                    const RigidTransform& world_from_left);

/// Standard deviation of each point along its optical axis, m: `Z² / (f·T) · σ_disparity`.
/// @param deviation_px H×W, CV_32FC1, NaN invalid
/// @return H×W, CV_32FC1, NaN invalid
[[nodiscard]] cv::Mat PointNoise_m(const cv::Mat& disparity_px, const cv::Mat& deviation_px,
                                   const Rectification& rectification);

}  // namespace granary
