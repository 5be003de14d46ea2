// How well a board calibration is known: the covariance that belongs to its corners.
#pragma once

#include <vector>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include "pipeline/types/calibration.h"

namespace granary {

/// The calibration with its parameters moved: added to, but for R, which is turned from the left by the step's small
/// rotation. The covariance stays as it is.
/// @param step in the order and the units of StereoCalibration::covariance
[[nodiscard]] StereoCalibration Moved(const StereoCalibration& calibration, const Eigen::VectorXd& step);

/// The covariance of the calibration as StereoCalibration::covariance wants it, from the corners that it was fitted to:
/// `σ² (JᵀJ)⁻¹`, J over the parameters of the pair and the pose of every board, the poses marginalised, σ² the sum of
/// the squared residuals over the degrees of freedom. Holds for a calibration that minimises the residuals of both
/// cameras together (cv::stereoCalibrate with CALIB_USE_INTRINSIC_GUESS, not with CALIB_FIX_INTRINSIC).
/// Distortion coefficients that are exactly 0 count as held fixed by the calibrator.
/// The board's own size is taken as exact: its relative error is one of T's length, and comes on top.
///
/// @param object_points one vector a view: the corners on the board, m; at least 4, not all on a line
/// @param left_corners, right_corners the same corners in both raw pictures, px
/// @return CV_64F, ParameterCount() square
/// @throws std::invalid_argument fewer than 3 views; counts that differ; numbers that are not finite; corners on a
/// line;
///   or views so alike that the parameters (named) are left open
/// Source: Hartley and Zisserman, Multiple View Geometry, 2nd ed., §5.2 and A6.3.
[[nodiscard]] cv::Mat StereoCovariance(const StereoCalibration& calibration,
                                       const std::vector<std::vector<cv::Point3f>>& object_points,
                                       const std::vector<std::vector<cv::Point2f>>& left_corners,
                                       const std::vector<std::vector<cv::Point2f>>& right_corners);

}  // namespace granary
