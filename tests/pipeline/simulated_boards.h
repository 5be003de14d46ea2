// Chessboards before a pair of cameras, with noise on their corners, and what OpenCV makes of them.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include <Eigen/Geometry>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "pipeline/calibration_covariance.h"
#include "pipeline/types/bin.h"
#include "pipeline/types/calibration.h"
#include "pipeline/types/transform.h"

namespace granary {

struct BoardViews {
  std::vector<std::vector<cv::Point3f>> object_points;
  std::vector<std::vector<cv::Point2f>> left, right;
};

/// The rig over the paper's box.
inline StereoCalibration LabPair() {
  StereoCalibration c;
  c.image_size = {1280, 1024};
  c.K1 = {1498.6, 0, 634.2, 0, 1500.3, 518.7, 0, 0, 1};
  c.K2 = {1503.9, 0, 647.1, 0, 1505.1, 507.3, 0, 0, 1};
  c.D1 = {-0.112, 0.094, 0.00042, -0.00031, 0};
  c.D2 = {-0.108, 0.087, -0.00027, 0.00036, 0};
  cv::Rodrigues(cv::Vec3d(-0.0052, 0.0209, -0.0068), c.R);
  c.T_m = {-0.1103, -0.00034, 0.0032};
  return c;
}

/// Boards of 9 × 6 inner corners, 32 mm apart, wholly in both pictures, near the height of the bin's top, tilted up to
/// `tilt_rad`. No noise.
inline BoardViews SimulatedBoards(const StereoCalibration& c, int views, std::uint64_t seed, double tilt_rad = 0.75) {
  constexpr int kCols = 9, kRows = 6;
  constexpr float kSquare_m = 0.032f;
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<cv::Point3f> board;
  for (int j = 0; j < kRows; ++j) {
    for (int i = 0; i < kCols; ++i) board.emplace_back(kSquare_m * i, kSquare_m * j, 0.f);
  }
  const cv::Rect2f picture(5, 5, c.image_size.width - 10.f, c.image_size.height - 10.f);
  const auto all_inside = [&](const std::vector<cv::Point2f>& corners) {
    for (const auto& p : corners) {
      if (!picture.contains(p)) return false;
    }
    return true;
  };
  BoardViews out;
  while (static_cast<int>(out.left.size()) < views) {
    const double direction = std::numbers::pi * unit(random);
    const Eigen::Matrix3d turn =
        (Eigen::AngleAxisd(tilt_rad * unit(random), Eigen::Vector3d(std::cos(direction), std::sin(direction), 0)) *
         Eigen::AngleAxisd(std::numbers::pi * unit(random), Eigen::Vector3d::UnitZ()))
            .toRotationMatrix();
    const double depth = 0.95 + 0.12 * unit(random);
    const Eigen::Vector3d middle(0.05 + 0.35 * unit(random), 0.3 * unit(random), depth);
    std::vector<cv::Point3d> left, right;
    for (const auto& corner : board) {
      const Eigen::Vector3d p =
          turn * Eigen::Vector3d(corner.x - 4 * kSquare_m, corner.y - 2.5 * kSquare_m, 0) + middle;
      left.emplace_back(p.x(), p.y(), p.z());
      right.emplace_back(c.R * cv::Vec3d(left.back()) + c.T_m);
    }
    std::vector<cv::Point2d> seen_left, seen_right;
    cv::projectPoints(left, cv::Vec3d(), cv::Vec3d(), c.K1, c.D1, seen_left);
    cv::projectPoints(right, cv::Vec3d(), cv::Vec3d(), c.K2, c.D2, seen_right);
    const std::vector<cv::Point2f> l(seen_left.begin(), seen_left.end()), r(seen_right.begin(), seen_right.end());
    if (!all_inside(l) || !all_inside(r)) continue;
    out.object_points.push_back(board);
    out.left.push_back(l);
    out.right.push_back(r);
  }
  return out;
}

/// Gaussian noise on every coordinate of every corner.
inline BoardViews Noisy(BoardViews views, double sigma_px, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<float> noise(0, static_cast<float>(sigma_px));
  for (auto* side : {&views.left, &views.right}) {
    for (auto& corners : *side) {
      for (auto& p : corners) p += cv::Point2f(noise(random), noise(random));
    }
  }
  return views;
}

/// The pair that fits the corners of both pictures best, with its covariance; k3 held at 0. The least squares end in
/// the same place wherever they begin, so they begin at `guess`.
inline StereoCalibration CalibrateBoards(const BoardViews& views, const StereoCalibration& guess) {
  cv::Mat K1(guess.K1, true), K2(guess.K2, true), D1(guess.D1, true), D2(guess.D2, true), R(guess.R, true);
  cv::Mat T(guess.T_m, true), essential, fundamental, errors;
  cv::stereoCalibrate(views.object_points, views.left, views.right, K1, D1, K2, D2, guess.image_size, R, T, essential,
                      fundamental, errors, cv::CALIB_USE_INTRINSIC_GUESS | cv::CALIB_FIX_K3,
                      cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 50, 1e-9));
  StereoCalibration out;
  out.image_size = guess.image_size;
  out.K1 = K1, out.K2 = K2, out.R = R;
  D1.reshape(1, 1).copyTo(out.D1);
  D2.reshape(1, 1).copyTo(out.D2);
  out.T_m = cv::Vec3d(T.at<double>(0), T.at<double>(1), T.at<double>(2));
  out.covariance = StereoCovariance(out, views.object_points, views.left, views.right);
  return out;
}

/// The pose that a board of 5×5 corners all over the bin's floor gives with the calibration `found`.
inline RigidTransform FoundPose(const Bin& bin, const StereoCalibration& truth, const RigidTransform& world_from_left,
                                const StereoCalibration& found) {
  const Eigen::AlignedBox2d box = Bounds(bin.footprint_m);
  const RigidTransform left_from_world = world_from_left.inverse();
  std::vector<cv::Point3d> board, in_left;
  for (int j = 0; j < 5; ++j) {
    for (int i = 0; i < 5; ++i) {
      const Eigen::Vector3d p(box.min().x() + box.sizes().x() * i / 4, box.min().y() + box.sizes().y() * j / 4, 0);
      const Eigen::Vector3d q = left_from_world * p;
      board.emplace_back(p.x(), p.y(), p.z());
      in_left.emplace_back(q.x(), q.y(), q.z());
    }
  }
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(in_left, cv::Vec3d(), cv::Vec3d(), truth.K1, truth.D1, pixels);
  cv::Vec3d turn, shift;
  cv::solvePnP(board, pixels, found.K1, found.D1, turn, shift);
  const Eigen::Vector3d axis(turn[0], turn[1], turn[2]);
  RigidTransform out = RigidTransform::Identity();
  out.linear() = Eigen::AngleAxisd(axis.norm(), axis.normalized()).toRotationMatrix();
  out.translation() << shift[0], shift[1], shift[2];
  return out.inverse();
}

}  // namespace granary
