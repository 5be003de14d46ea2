// One Gauss–Newton step's normal matrix at the solution. A board's pose moves only its own residuals, so each view's
// rows are freed of it by an orthogonal projection as they come, and the matrix that is inverted has the size of the
// pair's parameters whatever the number of views.
#include "pipeline/calibration_covariance.h"

#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <opencv2/calib3d.hpp>

namespace granary {

namespace {

// Differences are central and the functions smooth: steps of a hundredth of a pixel or so are far above rounding
// (1e-13 of the coordinate) and far below curvature.
constexpr double kPixelStep = 0.01, kCoefficientStep = 1e-4, kAngleStep = 1e-5, kLengthStep_m = 1e-5;
constexpr int kPoseSteps = 10;  // of Gauss–Newton from a pose that is near already: two or three settle it
// Least eigenvalue of the normal matrix scaled to a diagonal of ones; sixteen mixed views have 1e-6.
constexpr double kLeastEigenvalue = 1e-11;
// A focal length looser than this makes nonsense of a linear covariance.
constexpr double kLoosestFocal = 0.1;

using Pose = Eigen::Isometry3d;  // left camera from board

struct View {
  std::vector<Eigen::Vector3d> board;
  std::vector<cv::Point2f> left, right;
};

Eigen::Matrix3d Turn(const Eigen::Vector3d& rotation) {
  const double angle = rotation.norm();
  if (angle == 0) return Eigen::Matrix3d::Identity();
  return Eigen::AngleAxisd(angle, rotation / angle).toRotationMatrix();
}

Pose MovedPose(const Pose& pose, int parameter, double step) {
  Pose out = pose;
  if (parameter < 3) {
    out.linear() = Turn(step * Eigen::Vector3d::Unit(parameter)) * pose.linear();
  } else {
    out.translation()[parameter - 3] += step;
  }
  return out;
}

/// Where the pair would see the corners: x and y of all in the left picture, then of all in the right.
Eigen::VectorXd Project(const StereoCalibration& c, const View& view, const Pose& pose) {
  std::vector<cv::Point3d> points;
  points.reserve(view.board.size());
  for (const Eigen::Vector3d& corner : view.board) {
    const Eigen::Vector3d p = pose * corner;
    points.emplace_back(p.x(), p.y(), p.z());
  }
  std::vector<cv::Point2d> left, right;
  cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), c.K1, c.D1, left);
  for (cv::Point3d& p : points) p = cv::Point3d(c.R * cv::Vec3d(p) + c.T_m);
  cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), c.K2, c.D2, right);
  const auto count = static_cast<Eigen::Index>(points.size());
  Eigen::VectorXd out(4 * count);
  for (Eigen::Index i = 0; i < count; ++i) {
    out.segment<2>(2 * i) << left[i].x, left[i].y;
    out.segment<2>(2 * (count + i)) << right[i].x, right[i].y;
  }
  return out;
}

Eigen::VectorXd Residuals(const StereoCalibration& calibration, const View& view, const Pose& pose) {
  Eigen::VectorXd out = Project(calibration, view, pose);
  const auto count = static_cast<Eigen::Index>(view.board.size());
  for (Eigen::Index i = 0; i < count; ++i) {
    out.segment<2>(2 * i) -= Eigen::Vector2d(view.left[i].x, view.left[i].y);
    out.segment<2>(2 * (count + i)) -= Eigen::Vector2d(view.right[i].x, view.right[i].y);
  }
  return out;
}

Eigen::MatrixXd PoseJacobian(const StereoCalibration& calibration, const View& view, const Pose& pose) {
  Eigen::MatrixXd out(4 * static_cast<Eigen::Index>(view.board.size()), 6);
  for (int k = 0; k < 6; ++k) {
    const double step = k < 3 ? kAngleStep : kLengthStep_m;
    out.col(k) =
        (Project(calibration, view, MovedPose(pose, k, step)) - Project(calibration, view, MovedPose(pose, k, -step))) /
        (2 * step);
  }
  return out;
}

/// The pose that fits both pictures best.
Pose FitPose(const StereoCalibration& calibration, const View& view, const std::string& name) {
  std::vector<cv::Point3d> board;
  for (const Eigen::Vector3d& p : view.board) board.emplace_back(p.x(), p.y(), p.z());
  cv::Vec3d rotation, translation;
  if (!cv::solvePnP(board, view.left, calibration.K1, calibration.D1, rotation, translation)) {
    throw std::invalid_argument(name + ": no pose of the board fits its corners");
  }
  Pose pose = Pose::Identity();
  pose.linear() = Turn({rotation[0], rotation[1], rotation[2]});
  pose.translation() << translation[0], translation[1], translation[2];
  for (int i = 0; i < kPoseSteps; ++i) {
    const Eigen::Matrix<double, 6, 1> step =
        PoseJacobian(calibration, view, pose).colPivHouseholderQr().solve(-Residuals(calibration, view, pose));
    pose.linear() = Turn(step.head<3>()) * pose.linear();
    pose.translation() += step.tail<3>();
    if (step.norm() < 1e-9) break;
  }
  if (!pose.matrix().allFinite()) throw std::invalid_argument(name + ": no pose of the board fits its corners");
  return pose;
}

bool OnALine(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& p : points) mean += p / static_cast<double>(points.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const auto& p : points) spread += (p - mean) * (p - mean).transpose();
  const Eigen::Vector3d eigenvalues = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvalues();
  return !(eigenvalues[1] > 1e-6 * eigenvalues[2]);  // a thousandth as wide as long
}

std::vector<View> CheckedViews(const std::vector<std::vector<cv::Point3f>>& object_points,
                               const std::vector<std::vector<cv::Point2f>>& left_corners,
                               const std::vector<std::vector<cv::Point2f>>& right_corners) {
  if (left_corners.size() != object_points.size() || right_corners.size() != object_points.size()) {
    throw std::invalid_argument("calibration views: " + std::to_string(object_points.size()) + " boards, " +
                                std::to_string(left_corners.size()) + " left and " +
                                std::to_string(right_corners.size()) + " right pictures; as many of each are wanted");
  }
  if (object_points.size() < 3) {
    throw std::invalid_argument("calibration views: " + std::to_string(object_points.size()) +
                                "; at least 3 are wanted");
  }
  std::vector<View> views;
  for (std::size_t i = 0; i < object_points.size(); ++i) {
    const std::string name = "calibration view " + std::to_string(i + 1);
    const std::size_t count = object_points[i].size();
    if (left_corners[i].size() != count || right_corners[i].size() != count) {
      throw std::invalid_argument(name + ": " + std::to_string(count) + " corners on the board, " +
                                  std::to_string(left_corners[i].size()) + " in the left picture, " +
                                  std::to_string(right_corners[i].size()) + " in the right; as many are wanted");
    }
    if (count < 4) {
      throw std::invalid_argument(name + ": " + std::to_string(count) + " corners; at least 4 are wanted");
    }
    View& view = views.emplace_back(View{{}, left_corners[i], right_corners[i]});
    bool finite = true;
    for (std::size_t k = 0; k < count; ++k) {
      view.board.emplace_back(object_points[i][k].x, object_points[i][k].y, object_points[i][k].z);
      finite = finite && view.board.back().allFinite() && std::isfinite(view.left[k].x + view.left[k].y) &&
               std::isfinite(view.right[k].x + view.right[k].y);
    }
    if (!finite) throw std::invalid_argument(name + ": a corner is no finite number");
    if (OnALine(view.board)) throw std::invalid_argument(name + ": its corners lie on a line");
  }
  return views;
}

/// The parameters that the calibrator moved, with the step of their differences.
struct Parameter {
  int index;
  double step;
  std::string name;
};

std::vector<Parameter> FreeParameters(const StereoCalibration& c) {
  std::vector<Parameter> out;
  int index = 0;
  const auto camera = [&](const std::vector<double>& distortion, const std::string& number) {
    for (const char* name : {"fx", "fy", "cx", "cy"}) out.push_back({index++, kPixelStep, name + number});
    for (std::size_t i = 0; i < distortion.size(); ++i, ++index) {
      if (distortion[i] != 0) out.push_back({index, kCoefficientStep, "D" + number + "[" + std::to_string(i) + "]"});
    }
  };
  camera(c.D1, "1");
  camera(c.D2, "2");
  for (const char* name : {"R about x", "R about y", "R about z"}) out.push_back({index++, kAngleStep, name});
  for (const char* name : {"T x", "T y", "T z"}) out.push_back({index++, kLengthStep_m, name});
  return out;
}

[[noreturn]] void FailUndetermined(const std::string& name) {
  throw std::invalid_argument("the calibration views leave " + name +
                              " open: show the board tilted, at several distances and all over the pictures");
}

/// Inverse of a normal matrix whose rows differ by many powers of ten.
Eigen::MatrixXd Inverse(const Eigen::MatrixXd& normal, const std::vector<Parameter>& free) {
  for (Eigen::Index i = 0; i < normal.rows(); ++i) {
    if (!(normal(i, i) > 0)) FailUndetermined(free[i].name);
  }
  const Eigen::VectorXd scale = normal.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scale.asDiagonal() * normal * scale.asDiagonal());
  if (!(eigen.eigenvalues()[0] > kLeastEigenvalue)) {
    Eigen::Index weakest = 0;
    eigen.eigenvectors().col(0).cwiseAbs().maxCoeff(&weakest);
    FailUndetermined(free[weakest].name);
  }
  const Eigen::MatrixXd root =
      scale.asDiagonal() * eigen.eigenvectors() * eigen.eigenvalues().cwiseSqrt().cwiseInverse().asDiagonal();
  return root * root.transpose();
}

}  // namespace

StereoCalibration Moved(const StereoCalibration& calibration, const Eigen::VectorXd& step) {
  if (step.size() != calibration.ParameterCount()) {
    throw std::invalid_argument("a step of " + std::to_string(step.size()) + " parameters for a calibration of " +
                                std::to_string(calibration.ParameterCount()));
  }
  StereoCalibration out = calibration;
  Eigen::Index at = 0;
  for (const auto& [k, distortion] : {std::pair{&out.K1, &out.D1}, {&out.K2, &out.D2}}) {
    for (const auto& [row, col] : {std::pair{0, 0}, {1, 1}, {0, 2}, {1, 2}}) (*k)(row, col) += step[at++];
    for (double& coefficient : *distortion) coefficient += step[at++];
  }
  const Eigen::Matrix3d turn = Turn(step.segment<3>(at));
  cv::Matx33d rotation;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) rotation(r, c) = turn(r, c);
  }
  out.R = rotation * calibration.R;
  for (int i = 0; i < 3; ++i) out.T_m[i] += step[at + 3 + i];
  return out;
}

cv::Mat StereoCovariance(const StereoCalibration& calibration,
                         const std::vector<std::vector<cv::Point3f>>& object_points,
                         const std::vector<std::vector<cv::Point2f>>& left_corners,
                         const std::vector<std::vector<cv::Point2f>>& right_corners) {
  const std::vector<View> views = CheckedViews(object_points, left_corners, right_corners);
  const std::vector<Parameter> free = FreeParameters(calibration);
  const auto count = static_cast<Eigen::Index>(free.size());
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(count, count);
  double squares = 0;
  Eigen::Index freedom = -count;
  for (std::size_t v = 0; v < views.size(); ++v) {
    const View& view = views[v];
    const Pose pose = FitPose(calibration, view, "calibration view " + std::to_string(v + 1));
    const Eigen::VectorXd residuals = Residuals(calibration, view, pose);
    squares += residuals.squaredNorm();
    freedom += residuals.size() - 6;
    Eigen::MatrixXd jacobian(residuals.size(), count);
    for (Eigen::Index i = 0; i < count; ++i) {
      Eigen::VectorXd step = Eigen::VectorXd::Zero(calibration.ParameterCount());
      step[free[i].index] = free[i].step;
      jacobian.col(i) =
          (Project(Moved(calibration, step), view, pose) - Project(Moved(calibration, -step), view, pose)) /
          (2 * free[i].step);
    }
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(PoseJacobian(calibration, view, pose));
    jacobian.applyOnTheLeft(qr.householderQ().transpose());
    const auto rest = jacobian.bottomRows(residuals.size() - 6);  // what no move of the board can make up for
    normal += rest.transpose() * rest;
  }
  if (freedom <= 0) {
    throw std::invalid_argument("the calibration views have too few corners for " + std::to_string(count) +
                                " parameters of the pair and 6 of every board");
  }
  const Eigen::MatrixXd covariance = squares / static_cast<double>(freedom) * Inverse(normal, free);
  cv::Mat out = cv::Mat::zeros(calibration.ParameterCount(), calibration.ParameterCount(), CV_64F);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < count; ++j) out.at<double>(free[i].index, free[j].index) = covariance(i, j);
  }
  const int second = 4 + static_cast<int>(calibration.D1.size());
  for (const auto& [index, focal] : {std::pair{0, calibration.K1(0, 0)},
                                     {1, calibration.K1(1, 1)},
                                     {second, calibration.K2(0, 0)},
                                     {second + 1, calibration.K2(1, 1)}}) {
    if (std::sqrt(out.at<double>(index, index)) > kLoosestFocal * focal) FailUndetermined("the focal lengths");
  }
  return out;
}

}  // namespace granary
