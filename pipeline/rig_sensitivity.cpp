// Every cause of error displaces each point of grain and floor, and what that does to the volume is one sum. Points are
// triangulated in normalised coordinates, where the rectified pictures' focal length and principal points cancel.
#include "pipeline/rig_sensitivity.h"

#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "pipeline/calibration_covariance.h"
#include "pipeline/rectify.h"

namespace granary {

namespace {

using Points = Eigen::Matrix3Xd;

// Derivatives are taken over this share of a standard deviation: even a loose covariance stays linear, and differences
// are far above rounding.
constexpr double kStep = 0.01;
// Each round of cv::undistortPoints takes the error down by ten or more in lenses without a fisheye's bend; what is
// left is the same with either calibration.
constexpr int kUndistortRounds = 10;

/// What the rig sees: points of the grain in even columns, the floor's under them in odd ones.
struct Scene {
  Points points_in_left;
  Points weights_in_left;  ///< m²: a volume changes by the sum of products with the points' displacements
  std::vector<cv::Point2d> raw_left, raw_right;
  Eigen::Vector3d floor_middle_in_left;
  double camera_height_m = 0;  ///< above the middle of the floor
};

/// Raw pixels of points in one camera's frame; outside every picture when behind the camera.
std::vector<cv::Point2d> Project(const std::vector<cv::Point3d>& points, const cv::Matx33d& K,
                                 const std::vector<double>& D) {
  std::vector<cv::Point2d> pixels;
  if (points.empty()) return pixels;
  cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), K, D, pixels);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!(points[i].z > 0)) pixels[i] = {-1, -1};
  }
  return pixels;
}

Scene SceneOf(const std::vector<SurfaceSample>& samples, const StereoCalibration& calibration,
              const RigidTransform& world_from_left, FloorSource floor) {
  const RigidTransform left_from_world = world_from_left.inverse();
  const std::size_t count = samples.size();
  const double floor_counts = floor == FloorSource::kMeasured ? 1 : 0;
  Points points(3, 2 * count), weights(3, 2 * count);
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  double all_m2 = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const SurfaceSample& s = samples[i];
    const Eigen::Vector3d floor_point(s.grain_in_world.x(), s.grain_in_world.y(), s.floor_z_m);
    points.col(2 * i) = left_from_world * s.grain_in_world;
    points.col(2 * i + 1) = left_from_world * floor_point;
    weights.col(2 * i) = s.area_m2 * Eigen::Vector3d(-s.grain_slope.x(), -s.grain_slope.y(), 1);
    weights.col(2 * i + 1) = -floor_counts * s.area_m2 * Eigen::Vector3d(-s.floor_slope.x(), -s.floor_slope.y(), 1);
    middle += s.area_m2 * floor_point;
    all_m2 += s.area_m2;
  }
  middle /= all_m2;

  std::vector<cv::Point3d> left, right;
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    left.emplace_back(points(0, i), points(1, i), points(2, i));
    right.emplace_back(calibration.R * cv::Vec3d(left.back()) + calibration.T_m);
  }
  const auto left_pixels = Project(left, calibration.K1, calibration.D1);
  const auto right_pixels = Project(right, calibration.K2, calibration.D2);
  const cv::Rect2d picture(-0.5, -0.5, calibration.image_size.width, calibration.image_size.height);

  Scene scene;
  Eigen::Index kept = 0;
  double seen_m2 = 0;
  for (std::size_t i = 0; i < count; ++i) {
    bool seen = true;
    for (std::size_t k = 2 * i; k < 2 * i + 2; ++k) {
      seen = seen && picture.contains(left_pixels[k]) && picture.contains(right_pixels[k]);
    }
    if (!seen) continue;
    seen_m2 += samples[i].area_m2;
    for (std::size_t k = 2 * i; k < 2 * i + 2; ++k, ++kept) {
      points.col(kept) = points.col(k);
      weights.col(kept) = weights.col(k);
      scene.raw_left.push_back(left_pixels[k]);
      scene.raw_right.push_back(right_pixels[k]);
    }
  }
  if (!(seen_m2 > 0)) throw std::invalid_argument("no part of the surface lies in both pictures of the rig");
  scene.points_in_left = points.leftCols(kept);
  scene.weights_in_left = all_m2 / seen_m2 * (left_from_world.linear() * weights.leftCols(kept));
  scene.floor_middle_in_left = left_from_world * middle;
  scene.camera_height_m = world_from_left.translation().z() - middle.z();
  return scene;
}

/// Change of the volume when every point moves by its column.
double Change_m3(const Scene& scene, const Points& displacements_in_left) {
  return scene.weights_in_left.cwiseProduct(displacements_in_left).sum();
}

/// The scene's raw pixels as points in the left camera's frame, by that calibration.
Points Triangulate(const Scene& scene, const StereoCalibration& calibration) {
  const RectifiedCameras cameras = RectifyCameras(calibration);
  const cv::TermCriteria rounds(cv::TermCriteria::COUNT, kUndistortRounds, 0);
  std::vector<cv::Point2d> left, right;
  cv::undistortPoints(scene.raw_left, left, calibration.K1, calibration.D1, cameras.R1, cv::noArray(), rounds);
  cv::undistortPoints(scene.raw_right, right, calibration.K2, calibration.D2, cameras.R2, cv::noArray(), rounds);
  Eigen::Matrix3d left_from_rectified;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) left_from_rectified(r, c) = cameras.R1(c, r);
  }
  Points rectified(3, scene.points_in_left.cols());
  for (std::size_t i = 0; i < left.size(); ++i) {
    const double depth_m = cameras.Baseline_m() / (left[i].x - right[i].x);
    rectified.col(i) = depth_m * Eigen::Vector3d(left[i].x, left[i].y, 1);
  }
  return left_from_rectified * rectified;
}

/// The small turn and shift of the left camera (first three, last three) that takes the floor to where the raw left
/// picture has it by the calibration `after` instead of `before`.
Eigen::Matrix<double, 6, 1> PoseStep(const Scene& scene, const StereoCalibration& before,
                                     const StereoCalibration& after) {
  std::vector<cv::Point2d> floor, from, to;
  for (std::size_t i = 1; i < scene.raw_left.size(); i += 2) floor.push_back(scene.raw_left[i]);
  const cv::TermCriteria rounds(cv::TermCriteria::COUNT, kUndistortRounds, 0);
  cv::undistortPoints(floor, from, before.K1, before.D1, cv::noArray(), cv::noArray(), rounds);
  cv::undistortPoints(floor, to, after.K1, after.D1, cv::noArray(), cv::noArray(), rounds);
  const auto count = static_cast<Eigen::Index>(floor.size());
  Eigen::MatrixXd design(2 * count, 6);
  Eigen::VectorXd moves(2 * count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector3d p = scene.points_in_left.col(2 * i + 1);
    const double x = p.x() / p.z(), y = p.y() / p.z();
    design.row(2 * i) << -x * y, 1 + x * x, -y, 1 / p.z(), 0, -x / p.z();
    design.row(2 * i + 1) << -(1 + y * y), x * y, x, 0, 1 / p.z(), -y / p.z();
    moves.segment<2>(2 * i) << to[i].x - from[i].x, to[i].y - from[i].y;
  }
  return design.colPivHouseholderQr().solve(moves);
}

/// Columns whose squares sum to the covariance: one standard deviation along each independent direction.
Eigen::MatrixXd RootOf(const StereoCalibration& calibration) {
  const int count = calibration.ParameterCount();
  if (calibration.covariance.rows != count || calibration.covariance.cols != count) {
    throw std::invalid_argument("the covariance is " + std::to_string(calibration.covariance.rows) + "x" +
                                std::to_string(calibration.covariance.cols) + "; " + std::to_string(count) + "x" +
                                std::to_string(count) + " is wanted");
  }
  // Of the correlations, because px², rad² and m² lie many powers of ten apart.
  Eigen::VectorXd deviation(count);
  for (int i = 0; i < count; ++i) deviation[i] = std::sqrt(calibration.covariance.at<double>(i, i));
  Eigen::MatrixXd correlation = Eigen::MatrixXd::Zero(count, count);
  for (int i = 0; i < count; ++i) {
    for (int j = 0; j < count; ++j) {
      const double scale = deviation[i] * deviation[j];
      if (scale > 0) correlation(i, j) = calibration.covariance.at<double>(i, j) / scale;
    }
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(correlation);
  return deviation.asDiagonal() * eigen.eigenvectors() *
         eigen.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal();  // below 0 is rounding
}

double FromCovariance_m3(const Scene& scene, const StereoCalibration& calibration, PoseOrigin pose) {
  const Eigen::MatrixXd root = RootOf(calibration);
  const Points before = Triangulate(scene, calibration);
  double squares = 0;
  for (Eigen::Index k = 0; k < root.cols(); ++k) {
    if (root.col(k).isZero(0)) continue;
    const StereoCalibration moved = Moved(calibration, kStep * root.col(k));
    Points displacements = Triangulate(scene, moved) - before;
    if (pose == PoseOrigin::kFoundWithCalibration) {
      const Eigen::Matrix<double, 6, 1> step = PoseStep(scene, calibration, moved);
      for (Eigen::Index i = 0; i < displacements.cols(); ++i) {
        displacements.col(i) -= step.head<3>().cross(scene.points_in_left.col(i)) + step.tail<3>();
      }
    }
    const double change_m3 = Change_m3(scene, displacements) / kStep;
    squares += change_m3 * change_m3;
  }
  return std::sqrt(squares);
}

double FromDefault_m3(const Scene& scene, const StereoCalibration& calibration, PoseOrigin pose) {
  const RectifiedCameras cameras = RectifyCameras(calibration);
  const double focal_px = cameras.P1(0, 0);
  const Eigen::Vector3d axis(cameras.R1(2, 0), cameras.R1(2, 1), cameras.R1(2, 2));
  double scale_m3 = 0;
  Eigen::Vector3d disparity_m3 = Eigen::Vector3d::Zero(), turn_m3 = Eigen::Vector3d::Zero();
  for (Eigen::Index i = 0; i < scene.points_in_left.cols(); ++i) {
    const Eigen::Vector3d p = scene.points_in_left.col(i), weight = scene.weights_in_left.col(i);
    const cv::Vec3d rectified = cameras.R1 * cv::Vec3d(p.x(), p.y(), p.z());
    const double x = (focal_px * rectified[0] / rectified[2] + cameras.P1(0, 2)) / calibration.image_size.width;
    const double y = (focal_px * rectified[1] / rectified[2] + cameras.P1(1, 2)) / calibration.image_size.height;
    // Boards fix the size of things: errors of depth move a point along the optical axis, not along its ray.
    const double moved_m3 = rectified[2] * weight.dot(axis), per_px = rectified[2] / (focal_px * cameras.Baseline_m());
    scale_m3 += kDepthScale * moved_m3;
    disparity_m3 +=
        moved_m3 * per_px *
        Eigen::Vector3d(kDisparityOffset_px, kDisparitySlope_px * (x - 0.5), kDisparitySlope_px * (y - 0.5));
    turn_m3 += kPrincipalPoint_px / focal_px * p.cross(weight);  // a turn t moves p by t × p
  }
  if (pose == PoseOrigin::kFoundWithCalibration) turn_m3.setZero();  // the whole of a turn is the pose's
  return std::sqrt(scale_m3 * scale_m3 + disparity_m3.squaredNorm() + turn_m3.head<2>().squaredNorm());
}

double FromPose_m3(const Scene& scene) {
  Eigen::Vector3d shift_m2 = Eigen::Vector3d::Zero(), turn_m3 = Eigen::Vector3d::Zero();
  for (Eigen::Index i = 0; i < scene.points_in_left.cols(); ++i) {
    const Eigen::Vector3d p = scene.points_in_left.col(i) - scene.floor_middle_in_left;
    shift_m2 += scene.weights_in_left.col(i);
    turn_m3 += p.cross(scene.weights_in_left.col(i));
  }
  return std::hypot(kPoseShift * scene.camera_height_m * shift_m2.norm(), kPoseTurn_rad * turn_m3.norm());
}

}  // namespace

RigDeviation VolumeDeviation(const std::vector<SurfaceSample>& samples, const StereoCalibration& calibration,
                             const RigidTransform& world_from_left, FloorSource floor, PoseOrigin pose) {
  const Scene scene = SceneOf(samples, calibration, world_from_left, floor);
  RigDeviation out;
  out.pose_m3 = FromPose_m3(scene);
  if (!calibration.covariance.empty()) {
    out.calibration_m3 = FromCovariance_m3(scene, calibration, pose);
  } else if (floor == FloorSource::kMeasured || pose == PoseOrigin::kIndependent) {
    out.calibration_m3 = FromDefault_m3(scene, calibration, pose);
  } else {
    const Scene over_floor = SceneOf(samples, calibration, world_from_left, FloorSource::kMeasured);
    double floor_m2 = 0;
    for (const SurfaceSample& sample : samples) floor_m2 += sample.area_m2;
    out.calibration_m3 =
        std::hypot(FromDefault_m3(over_floor, calibration, pose), kFoundFloor * scene.camera_height_m * floor_m2);
  }
  return out;
}

}  // namespace granary
