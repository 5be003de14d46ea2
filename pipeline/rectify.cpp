// OpenCV does the geometry; both pictures keep their own principal point, which keeps disparities small on a toed-in
// rig.
#include "pipeline/rectify.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "pipeline/stereo/usable.h"

namespace granary {

namespace {

cv::Mat InsideMask(const cv::Mat& map_x, const cv::Mat& map_y, cv::Size raw) {
  // One pixel of margin for the cubic kernel.
  cv::Mat in_x, in_y;
  cv::inRange(map_x, 1.0, raw.width - 3.0, in_x);
  cv::inRange(map_y, 1.0, raw.height - 3.0, in_y);
  return in_x & in_y;
}

cv::Mat ToGrey255(const Frame& frame, const std::optional<Frame>& ambient) {
  cv::Mat grey;
  frame.image.convertTo(grey, CV_32FC1, 255.0 / frame.SaturationLevel());
  if (ambient) {
    cv::Mat dark;
    ambient->image.convertTo(dark, CV_32FC1, 255.0 / frame.SaturationLevel());
    grey -= dark;
  }
  return grey;
}

std::string Describe(const Frame& frame) {
  if (frame.image.empty()) return "is empty";
  return std::to_string(frame.image.cols) + " x " + std::to_string(frame.image.rows) + " px, " +
         (frame.image.depth() == CV_8U    ? "8-bit"
          : frame.image.depth() == CV_16U ? "16-bit"
                                          : "of another depth") +
         (frame.image.channels() == 1 ? "" : ", " + std::to_string(frame.image.channels()) + " channels");
}

}  // namespace

RectifiedCameras RectifyCameras(const StereoCalibration& calibration) {
  RectifiedCameras out;
  cv::Matx44d Q;
  cv::stereoRectify(calibration.K1, calibration.D1, calibration.K2, calibration.D2, calibration.image_size,
                    calibration.R, calibration.T_m, out.R1, out.R2, out.P1, out.P2, Q, 0, -1, calibration.image_size);
  if (std::abs(out.P2(1, 3)) > std::abs(out.P2(0, 3))) {
    throw std::invalid_argument("the cameras stand one above the other; they must stand side by side");
  }
  if (out.P2(0, 3) >= 0) {
    throw std::invalid_argument(
        "the right camera lies to the left of the left one: T must have a negative x, "
        "are the sides exchanged?");
  }
  return out;
}

Rectification ComputeRectification(const StereoCalibration& calibration) {
  const RectifiedCameras cameras = RectifyCameras(calibration);
  const auto& [R1, R2, P1, P2] = cameras;
  Rectification out;
  out.size = calibration.image_size;
  out.focal_px = P1(0, 0);
  out.baseline_m = cameras.Baseline_m();
  out.left_cx_px = P1(0, 2);
  out.right_cx_px = P2(0, 2);
  out.cy_px = P1(1, 2);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) out.left_from_rectified.linear()(r, c) = R1(c, r);
  }
  cv::initUndistortRectifyMap(calibration.K1, calibration.D1, R1, P1, out.size, CV_32FC1, out.left_map_x,
                              out.left_map_y);
  cv::initUndistortRectifyMap(calibration.K2, calibration.D2, R2, P2, out.size, CV_32FC1, out.right_map_x,
                              out.right_map_y);
  out.left_inside = InsideMask(out.left_map_x, out.left_map_y, calibration.image_size);
  out.right_inside = InsideMask(out.right_map_x, out.right_map_y, calibration.image_size);
  return out;
}

RectifiedPair RectifyPair(const FramePair& pair, const Rectification& rectification) {
  RectifiedPair out;
  const cv::Mat left = ToGrey255(pair.left, pair.ambient_left), right = ToGrey255(pair.right, pair.ambient_right);
  cv::remap(left, out.left, rectification.left_map_x, rectification.left_map_y, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  cv::remap(right, out.right, rectification.right_map_x, rectification.right_map_y, cv::INTER_CUBIC,
            cv::BORDER_REPLICATE);
  const cv::Mat left_full = pair.left.image >= pair.left.SaturationLevel();
  const cv::Mat right_full = pair.right.image >= pair.right.SaturationLevel();
  out.saturated_fraction =
      std::max(cv::countNonZero(left_full), cv::countNonZero(right_full)) / static_cast<double>(left_full.total());
  const auto usable = [](const cv::Mat& full, const cv::Mat& map_x, const cv::Mat& map_y, const cv::Mat& inside) {
    cv::Mat saturated;
    cv::remap(SaturatedAreas(full), saturated, map_x, map_y, cv::INTER_NEAREST);
    return cv::Mat(inside & ~saturated);
  };
  out.usable.left = usable(left_full, rectification.left_map_x, rectification.left_map_y, rectification.left_inside);
  out.usable.right =
      usable(right_full, rectification.right_map_x, rectification.right_map_y, rectification.right_inside);
  return out;
}

std::string FrameFault(const FramePair& pair, cv::Size calibrated_size) {
  const auto fault = [&](const Frame& frame, const char* side) -> std::string {
    const cv::Mat& image = frame.image;
    if (!image.empty() && (image.type() == CV_8UC1 || image.type() == CV_16UC1) && image.size() == calibrated_size)
      return {};
    return std::string(side) + " frame " + frame.source + ": " + Describe(frame) +
           "; it must have one channel of 8 or 16 bits and the calibrated size, " +
           std::to_string(calibrated_size.width) + " x " + std::to_string(calibrated_size.height) + " px";
  };
  if (auto words = fault(pair.left, "left"); !words.empty()) return words;
  if (auto words = fault(pair.right, "right"); !words.empty()) return words;
  if (pair.left.image.type() != pair.right.image.type()) {
    return "left frame " + pair.left.source + " is " + Describe(pair.left) + ", right frame " + pair.right.source +
           " is " + Describe(pair.right) + "; both must have the same depth";
  }
  for (const auto& [ambient, lit] : {std::pair{&pair.ambient_left, &pair.left}, {&pair.ambient_right, &pair.right}}) {
    if (*ambient && ((*ambient)->image.size() != lit->image.size() || (*ambient)->image.type() != lit->image.type())) {
      return "ambient frame " + (*ambient)->source + " differs in size or depth from " + lit->source;
    }
  }
  if (pair.ambient_left.has_value() != pair.ambient_right.has_value()) {
    return "an ambient frame was given for one side only; give both or none";
  }
  return {};
}

RangeProposal ProposeRange(const Bin& bin, const Rectification& rectification, const RigidTransform& world_from_left,
                           int max_count) {
  // Room for a floor that is lower than z = 0 in places, for the noise of the winner, and for the interpolation.
  constexpr int kFarMargin_px = 4, kNearMargin_px = 4;
  const RigidTransform rectified_from_world = (world_from_left * rectification.left_from_rectified).inverse();
  double farthest_m = 0, nearest_m = std::numeric_limits<double>::infinity();
  for (const auto& corner : bin.footprint_m) {
    farthest_m = std::max(farthest_m, (rectified_from_world * Eigen::Vector3d(corner.x(), corner.y(), 0)).z());
    nearest_m = std::min(nearest_m, (rectified_from_world * Eigen::Vector3d(corner.x(), corner.y(), bin.height_m)).z());
  }
  if (!(farthest_m > 0)) {
    throw std::invalid_argument("the bin's floor lies behind the cameras; check the pose");
  }
  RangeProposal out;
  const int low = static_cast<int>(std::floor(rectification.Disparity_px(farthest_m))) - kFarMargin_px;
  const double top = nearest_m > 0 ? rectification.Disparity_px(nearest_m) + kNearMargin_px : 1e9;
  out.reaches_top = top < low + max_count;
  const int high = out.reaches_top ? static_cast<int>(std::ceil(top)) : low + max_count - 1;
  out.range = {low, high - low + 1};
  out.nearest_m = rectification.Depth_m(high);
  return out;
}

}  // namespace granary
