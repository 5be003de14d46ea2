// Turns a raw pair into one whose epipolar lines are rows, and says how disparities become depths.
#pragma once

#include <string>

#include <opencv2/core/mat.hpp>
#include <opencv2/core/matx.hpp>

#include "pipeline/stereo/aggregate.h"
#include "pipeline/stereo/usable.h"
#include "pipeline/types/bin.h"
#include "pipeline/types/calibration.h"
#include "pipeline/types/frame.h"
#include "pipeline/types/transform.h"

namespace granary {

/// Everything that follows from a calibration and never changes (METHOD §1).
struct Rectification {
  cv::Size size;  ///< of raw and rectified pictures, px
  double focal_px = 0;
  double baseline_m = 0;
  double left_cx_px = 0, right_cx_px = 0, cy_px = 0;
  RigidTransform left_from_rectified = RigidTransform::Identity();
  cv::Mat left_map_x, left_map_y, right_map_x, right_map_y;  ///< CV_32FC1: raw position of each rectified pixel
  cv::Mat left_inside, right_inside;                         ///< CV_8UC1, 255 where the raw picture reaches

  /// Depth along the rectified optical axis, m: `Z = f·T / ((x_l − x_r) − (D_l − D_r))` (METHOD §4).
  [[nodiscard]] double Depth_m(double disparity_px) const {
    return focal_px * baseline_m / (disparity_px - (left_cx_px - right_cx_px));
  }
  /// The disparity of a point at that depth, px.
  [[nodiscard]] double Disparity_px(double depth_m) const {
    return focal_px * baseline_m / depth_m + (left_cx_px - right_cx_px);
  }
  /// Change of depth for one pixel of disparity at that depth, m/px.
  [[nodiscard]] double DepthStep_m(double depth_m) const { return depth_m * depth_m / (focal_px * baseline_m); }
};

/// Where a rectification puts the cameras, as cv::stereoRectify has it; cheap, unlike the maps.
struct RectifiedCameras {
  cv::Matx33d R1, R2;  ///< rectified from left, rectified from right
  cv::Matx34d P1, P2;  ///< projection of rectified points, px and px·m

  [[nodiscard]] double Baseline_m() const { return -P2(0, 3) / P2(0, 0); }
};

/// @throws std::invalid_argument as ComputeRectification
[[nodiscard]] RectifiedCameras RectifyCameras(const StereoCalibration& calibration);

/// @throws std::invalid_argument when the right camera is not to the right of the left one (sides exchanged, or one
///   above the other)
[[nodiscard]] Rectification ComputeRectification(const StereoCalibration& calibration);

/// A rectified pair in grey levels of 0 … 255 whatever the bit depth, ambient light taken off where it was given.
struct RectifiedPair {
  cv::Mat left, right;            ///< CV_32FC1
  UsablePixels usable;            ///< 0 outside the raw pictures and where they are saturated
  double saturated_fraction = 0;  ///< share of full pixels, the worse frame
};

/// @param pair frames of the calibrated size; see FrameFault
[[nodiscard]] RectifiedPair RectifyPair(const FramePair& pair, const Rectification& rectification);

/// What is wrong with the frames of a pair, empty when nothing is: size, depth, channels, left against right.
[[nodiscard]] std::string FrameFault(const FramePair& pair, cv::Size calibrated_size);

/// The disparities between the floor and the top of the bin.
struct RangeProposal {
  DisparityRange range;
  double nearest_m = 0;     ///< depth of the largest disparity searched
  bool reaches_top = true;  ///< false: the top of the bin is nearer than the largest disparity allowed
};

/// From the bin's geometry, so that nobody types disparities: farthest the floor, nearest the top of the bin.
/// @param max_count most disparities searched; a bin whose top needs more is searched up to `nearest_m`
[[nodiscard]] RangeProposal ProposeRange(const Bin& bin, const Rectification& rectification,
                                         const RigidTransform& world_from_left, int max_count);

}  // namespace granary
