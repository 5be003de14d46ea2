// Two views of the same calibrations: the depths that they get wrong, fitted by a scale, a disparity offset and two
// disparity slopes after the turn of the rays is taken off; and the deviations that their covariances state.
#include "tests/bench/calibration_modes.h"

#include <algorithm>
#include <cstdio>
#include <string>
#include <tuple>
#include <vector>

#include <Eigen/Dense>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "pipeline/rectify.h"
#include "pipeline/rig_sensitivity.h"
#include "tests/pipeline/simulated_boards.h"

namespace granary {

namespace {

constexpr int kModes = 6;  // scale, offset px, slope x px, slope y px, turn about x px, turn about y px

/// Points throughout the bin, in the left camera's frame.
std::vector<cv::Point3d> BinPoints(const RigWorld& world) {
  const Eigen::AlignedBox2d box = Bounds(world.bin.footprint_m);
  const RigidTransform left_from_world = world.world_from_left.inverse();
  std::vector<cv::Point3d> out;
  for (int k = 0; k < 5; ++k) {
    for (int j = 0; j < 10; ++j) {
      for (int i = 0; i < 10; ++i) {
        const Eigen::Vector2d at =
            box.min() + box.sizes().cwiseProduct(Eigen::Vector2d((i + 0.5) / 10, (j + 0.5) / 10));
        const Eigen::Vector3d p = left_from_world * Eigen::Vector3d(at.x(), at.y(), world.bin.height_m * k / 5);
        out.emplace_back(p.x(), p.y(), p.z());
      }
    }
  }
  return out;
}

/// Where the true pair's pixels of those points lie by another calibration.
std::vector<cv::Point3d> Triangulated(const std::vector<cv::Point3d>& points, const StereoCalibration& truth,
                                      const StereoCalibration& found) {
  std::vector<cv::Point3d> in_right;
  for (const auto& p : points) in_right.emplace_back(truth.R * cv::Vec3d(p) + truth.T_m);
  std::vector<cv::Point2d> left, right;
  cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), truth.K1, truth.D1, left);
  cv::projectPoints(in_right, cv::Vec3d(), cv::Vec3d(), truth.K2, truth.D2, right);
  const RectifiedCameras cameras = RectifyCameras(found);
  cv::undistortPoints(left, left, found.K1, found.D1, cameras.R1);
  cv::undistortPoints(right, right, found.K2, found.D2, cameras.R2);
  std::vector<cv::Point3d> out;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double depth_m = cameras.Baseline_m() / (left[i].x - right[i].x);
    out.emplace_back(cameras.R1.t() * (depth_m * cv::Vec3d(left[i].x, left[i].y, 1)));
  }
  return out;
}

Eigen::Matrix<double, kModes, 1> ModesOf(const std::vector<cv::Point3d>& points, const StereoCalibration& truth,
                                         const StereoCalibration& found) {
  const RectifiedCameras cameras = RectifyCameras(truth);
  const double f = cameras.P1(0, 0), baseline_m = cameras.Baseline_m();
  const auto moved = Triangulated(points, truth, found);
  const auto count = static_cast<Eigen::Index>(points.size());
  Eigen::MatrixXd design(3 * count, kModes);
  Eigen::VectorXd shares(3 * count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const cv::Vec3d p = cameras.R1 * cv::Vec3d(points[i]), q = cameras.R1 * cv::Vec3d(moved[i]);
    const double x = p[0] / p[2], y = p[1] / p[2], per_px = p[2] / (f * baseline_m);
    const double column = (f * x + cameras.P1(0, 2)) / truth.image_size.width - 0.5;
    const double row = (f * y + cameras.P1(1, 2)) / truth.image_size.height - 0.5;
    // A turn (a, b) about x and y moves p by (b z, −a z, a y − b x).
    design.row(3 * i) << 1, per_px, column * per_px, row * per_px, y / f, -x / f;
    design.row(3 * i + 1) << 0, 0, 0, 0, -(1 + y * y) / f, x * y / f;
    design.row(3 * i + 2) << 0, 0, 0, 0, -x * y / f, (1 + x * x) / f;
    shares[3 * i] = q[2] / p[2] - 1;
    shares[3 * i + 1] = q[1] / q[2] - y;
    shares[3 * i + 2] = q[0] / q[2] - x;
  }
  return design.colPivHouseholderQr().solve(shares);
}

std::vector<SurfaceSample> Grain(const RigWorld& world, double height_m, double slope_x, double slope_y) {
  const Eigen::AlignedBox2d box = Bounds(world.bin.footprint_m);
  std::vector<SurfaceSample> out;
  for (int j = 0; j < 20; ++j) {
    for (int i = 0; i < 20; ++i) {
      const Eigen::Vector2d from_middle = box.sizes().cwiseProduct(Eigen::Vector2d((i - 9.5) / 20, (j - 9.5) / 20));
      SurfaceSample& s = out.emplace_back();
      s.grain_slope = {slope_x, slope_y};
      s.grain_in_world << box.center() + from_middle, height_m + s.grain_slope.dot(from_middle);
      s.area_m2 = GrainFloor_m2(world.bin) / 400;
    }
  }
  return out;
}

}  // namespace

void PrintCalibrationModes(const RigWorld& world, int calibrations) {
  const auto points = BinPoints(world);
  std::vector<StereoCalibration> found;
  Eigen::MatrixXd modes(kModes, calibrations);
  for (int i = 0; i < calibrations; ++i) {
    const BoardViews boards = SimulatedBoards(world.calibration, 16, 1000 + i);
    found.push_back(CalibrateBoards(Noisy(boards, 0.1, 2000 + i), world.calibration));
    modes.col(i) = ModesOf(points, world.calibration, found.back());
  }
  const Eigen::MatrixXd second = modes * modes.transpose() / calibrations;
  const Eigen::VectorXd rms = second.diagonal().cwiseSqrt();
  std::printf("%d calibrations, 16 views of 9x6 corners each, 0.1 px. Root mean squares of\n", calibrations);
  std::printf("  depth scale %.2e   disparity offset %.3f px (their correlation %.2f)\n", rms[0], rms[1],
              second(0, 1) / (rms[0] * rms[1]));
  std::printf("  disparity slope %.3f px across, %.3f px down   turn of the rays %.2f px about x, %.2f px about y\n",
              rms[2], rms[3], rms[4], rms[5]);
  std::printf("\nstandard deviation in %% of the volume\n%-46s %8s %8s %8s %9s %8s\n", "grain 0.1 m deep", "least",
              "median", "most", "default", "pose");
  struct Case {
    const char* name;
    double slope_x, slope_y;
  };
  for (const Case& c : {Case{"level", 0, 0}, {"slope 0.3 along x", 0.3, 0}, {"slope 0.3 along y", 0, 0.3}}) {
    for (const auto& [floor, pose, name] :
         {std::tuple{FloorSource::kMeasured, PoseOrigin::kIndependent, "measured floor"},
          {FloorSource::kMeasured, PoseOrigin::kFoundWithCalibration, "measured floor, found pose"},
          {FloorSource::kPose, PoseOrigin::kIndependent, "floor z = 0"},
          {FloorSource::kPose, PoseOrigin::kFoundWithCalibration, "floor z = 0, found pose"}}) {
      const auto samples = Grain(world, 0.1, c.slope_x, c.slope_y);
      const double percent = 100 / (0.1 * GrainFloor_m2(world.bin));
      std::vector<double> stated;
      for (const StereoCalibration& calibration : found) {
        stated.push_back(percent *
                         VolumeDeviation(samples, calibration, world.world_from_left, floor, pose).calibration_m3);
      }
      std::sort(stated.begin(), stated.end());
      const RigDeviation plain = VolumeDeviation(samples, world.calibration, world.world_from_left, floor, pose);
      std::printf("%-18s %-27s %8.3f %8.3f %8.3f %9.3f %8.3f\n", c.name, name, stated.front(),
                  stated[stated.size() / 2], stated.back(), percent * plain.calibration_m3, percent * plain.pose_m3);
    }
  }
}

}  // namespace granary
