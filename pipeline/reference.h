// The empty bin as one rig saw it: what grain is measured against.
#pragma once

#include <string>

#include <opencv2/core/mat.hpp>

#include "pipeline/types/calibration.h"
#include "pipeline/types/frame.h"
#include "pipeline/types/transform.h"

namespace granary {

/// Taken once at commissioning (METHOD §5, cloud P2).
struct Reference {
  std::string id;        ///< e.g. "bin1-a-20261122T060000Z"
  std::string hash;      ///< 16 hex digits over the points
  std::string rig_hash;  ///< HashOfRig of the calibration and pose it was taken with
  UtcTime utc{};
  bool simulated = false;
  cv::Mat points_in_world;  ///< H×W (rectified left frame), CV_32FC3, metres, NaN invalid
  cv::Mat noise_m;          ///< H×W, CV_32FC1, standard deviation of a point along its ray, NaN invalid
};

/// 16 hex digits that change when calibration or pose change: a reference fits only the rig it was taken with.
[[nodiscard]] std::string HashOfRig(const StereoCalibration& calibration, const RigidTransform& world_from_left);
/// 16 hex digits over the bytes of the points (FNV-1a, 64 bit).
[[nodiscard]] std::string HashOfPoints(const cv::Mat& points_in_world);

}  // namespace granary
