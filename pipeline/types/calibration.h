// What a stereo.yml holds.
#pragma once

#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>
#include <opencv2/core/matx.hpp>
#include <opencv2/core/types.hpp>

namespace granary {

/// Brown–Conrady camera pair: `X_right = R·X_left + T` (Zhao 2023, §3.2–3.3).
struct StereoCalibration {
  cv::Size image_size;         ///< pixels
  cv::Matx33d K1, K2;          ///< pixels; pixel centres at integers
  std::vector<double> D1, D2;  ///< k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 tx ty]]]
  cv::Matx33d R = cv::Matx33d::eye();
  cv::Vec3d T_m;

  /// How well the above is known: CV_64F, n×n with n = ParameterCount(), empty when unknown. It is no part of the
  /// calibration: two that differ in nothing else measure alike. Its order, as in a file:
  ///
  ///     fx1 fy1 cx1 cy1   px
  ///     D1                all its coefficients, as stored
  ///     fx2 fy2 cx2 cy2   px
  ///     D2
  ///     rotation of R     3, rad: a small turn r from the left, R_true = exp([r]×)·R
  ///     T                 3, m
  ///
  /// Rows and columns of what was held fixed are 0.
  cv::Mat covariance;

  /// The length of the above order.
  [[nodiscard]] int ParameterCount() const { return 14 + static_cast<int>(D1.size() + D2.size()); }
  [[nodiscard]] double Baseline_m() const { return cv::norm(T_m); }
};

}  // namespace granary
