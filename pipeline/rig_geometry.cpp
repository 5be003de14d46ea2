#include "pipeline/rig_geometry.h"

#include <cstdint>
#include <stdexcept>
#include <utility>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "pipeline/floor.h"

namespace granary {

namespace {

cv::Point2d Project(const Rectification& r, const Eigen::Vector3d& point, double cx) {
  return {r.focal_px * point.x() / point.z() + cx, r.focal_px * point.y() / point.z() + r.cy_px};
}

void MaskFloor(const Bin& bin, RigGeometry& geometry) {
  const Rectification& r = geometry.rectification;
  geometry.left_mask = cv::Mat::zeros(r.size, CV_8UC1);
  geometry.right_mask = cv::Mat::zeros(r.size, CV_8UC1);
  std::vector<cv::Point> left, right;
  for (const auto& corner : bin.footprint_m) {
    const Eigen::Vector3d p = geometry.rectified_from_world * Eigen::Vector3d(corner.x(), corner.y(), 0);
    if (p.z() <= 0) continue;
    left.emplace_back(Project(r, p, r.left_cx_px));
    right.emplace_back(Project(r, p - Eigen::Vector3d(r.baseline_m, 0, 0), r.right_cx_px));
  }
  cv::fillPoly(geometry.left_mask, std::vector{left}, 255);
  cv::fillPoly(geometry.right_mask, std::vector{right}, 255);
  geometry.left_mask &= r.left_inside;
  geometry.right_mask &= r.right_inside;

  constexpr int kSamples = 40;
  const Eigen::AlignedBox2d box = Bounds(bin.footprint_m);
  int all = 0, seen = 0;
  const cv::Rect picture({0, 0}, r.size);
  for (int j = 0; j < kSamples; ++j) {
    for (int i = 0; i < kSamples; ++i) {
      const Eigen::Vector2d place =
          box.min() + box.sizes().cwiseProduct(Eigen::Vector2d((i + 0.5) / kSamples, (j + 0.5) / kSamples));
      if (!IsGrainFloor(bin, place)) continue;
      ++all;
      const Eigen::Vector3d p = geometry.rectified_from_world * Eigen::Vector3d(place.x(), place.y(), 0);
      if (p.z() <= 0) continue;
      const cv::Point l(Project(r, p, r.left_cx_px));
      const cv::Point q(Project(r, p - Eigen::Vector3d(r.baseline_m, 0, 0), r.right_cx_px));
      seen += picture.contains(l) && picture.contains(q) && r.left_inside.at<std::uint8_t>(l) &&
              r.right_inside.at<std::uint8_t>(q);
    }
  }
  geometry.floor_in_view = all > 0 ? static_cast<double>(seen) / all : 0;
}

}  // namespace

RigGeometry DescribeRig(RigSetup setup, const Bin& bin, const PipelineOptions& options) {
  RigGeometry geometry;
  try {
    geometry.rectification = ComputeRectification(setup.calibration);
    geometry.range = ProposeRange(bin, geometry.rectification, setup.world_from_left, options.stereo.max_disparities);
  } catch (const std::exception& error) {
    throw std::invalid_argument("rig " + setup.name + ": " + error.what());
  }
  const RigidTransform world_from_rectified = setup.world_from_left * geometry.rectification.left_from_rectified;
  geometry.rectified_from_world = world_from_rectified.inverse();
  geometry.camera_height_m = world_from_rectified.translation().z();
  const double floor_depth_m =
      geometry.rectification.Depth_m(geometry.range.range.min_px + 4.0);  // the far margin of the proposal taken off
  geometry.floor_step_m = geometry.rectification.DepthStep_m(floor_depth_m);
  geometry.spacing_m = floor_depth_m / geometry.rectification.focal_px;
  if (setup.reference) {
    const Reference& reference = *setup.reference;
    if (reference.points_in_world.size() != geometry.rectification.size ||
        reference.points_in_world.type() != CV_32FC3) {
      throw std::invalid_argument("rig " + setup.name + ": reference " + reference.id +
                                  " was taken with another picture size; take it again");
    }
    if (reference.rig_hash != HashOfRig(setup.calibration, setup.world_from_left)) {
      throw std::invalid_argument("rig " + setup.name + ": reference " + reference.id +
                                  " was taken with another calibration or pose; take it again");
    }
  }
  geometry.setup = std::move(setup);
  MaskFloor(bin, geometry);
  return geometry;
}

}  // namespace granary
