// What a stereo.yml holds.
#pragma once

#include <string>
#include <vector>

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

  [[nodiscard]] double Baseline_m() const { return cv::norm(T_m); }
};

}  // namespace granary
