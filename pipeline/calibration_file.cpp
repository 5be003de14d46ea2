// OpenCV's FileStorage does the parsing, from memory, so that a missing file is told from a bad one. Everything it
// hands out is then checked against what a camera pair can be: a bad calibration measures wrongly without a word
// otherwise.
#include "pipeline/calibration_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include <opencv2/core.hpp>

#include "pipeline/file_bytes.h"
#include "pipeline/file_error.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

constexpr double kRotationTolerance = 1e-4;    // files written with 5 digits still pass; a wrong matrix does not
constexpr double kCovarianceTolerance = 1e-4;  // of the correlations: the same 5 digits
constexpr double kLargestBaseline_m = 20;      // beyond the largest store: T was given in millimetres

/// One YAML file being read; every fault names the file and the key.
class YamlReader {
 public:
  explicit YamlReader(const fs::path& file) : file_(file) {
    const std::string text = ReadBytes(file);
    try {
      storage_.open(text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    } catch (const cv::Exception& error) {
      throw FileError(file_, "is no OpenCV YAML: " + Words(error));
    }
    if (!storage_.isOpened()) throw FileError(file_, "is no OpenCV YAML (it has to begin with %YAML)");
  }

  [[noreturn]] void Fail(const std::string& key, const std::string& fault) const {
    throw FileError(file_, key + ": " + fault);
  }

  bool Has(const std::string& key) const {
    const cv::FileNode root = storage_.root();
    return root.isMap() && !root[key].empty();
  }

  int PositiveInt(const std::string& key) const {
    const cv::FileNode node = Node(key);
    if (!node.isInt() && !node.isReal()) Fail(key, "is no number; a whole number of pixels above 0 is wanted");
    const double value = node.real();
    if (!(value > 0) || value != std::floor(value) || value > 1e6) {
      Fail(key, "is " + Number(value) + "; a whole number of pixels above 0 is wanted");
    }
    return static_cast<int>(value);
  }

  /// CV_64FC1, finite; of `rows` × `cols`.
  cv::Mat Matrix(const std::string& key, int rows, int cols) const {
    const cv::Mat matrix = Matrix(key);
    if (matrix.rows != rows || matrix.cols != cols) {
      Fail(key, "is " + Shape(matrix) + "; " + std::to_string(rows) + "x" + std::to_string(cols) + " is wanted");
    }
    return matrix;
  }

  /// A row or a column of `counts` values.
  std::vector<double> Vector(const std::string& key, const std::vector<int>& counts, const std::string& allowed) const {
    const cv::Mat matrix = Matrix(key);
    const int count = static_cast<int>(matrix.total());
    if (std::min(matrix.rows, matrix.cols) != 1 || std::find(counts.begin(), counts.end(), count) == counts.end()) {
      Fail(key, "is " + Shape(matrix) + "; one row or column of " + allowed + " is wanted");
    }
    return {matrix.begin<double>(), matrix.end<double>()};
  }

  static std::string Number(double value) {
    if (std::isnan(value)) return "nan";  // whatever its sign
    std::array<char, 40> text{};
    std::snprintf(text.data(), text.size(), "%.6g", value);
    return text.data();
  }

 private:
  static std::string Words(const cv::Exception& error) {
    std::string words = error.err.empty() ? error.what() : error.err;
    std::replace(words.begin(), words.end(), '\n', ' ');
    return words;
  }
  static std::string Shape(const cv::Mat& matrix) {
    return std::to_string(matrix.rows) + "x" + std::to_string(matrix.cols);
  }

  cv::FileNode Node(const std::string& key) const {
    const cv::FileNode root = storage_.root();
    if (!root.isMap()) Fail(key, "is missing (the file holds no keys at all)");
    const cv::FileNode node = root[key];
    if (node.empty()) Fail(key, "is missing");
    return node;
  }

  cv::Mat Matrix(const std::string& key) const {
    const cv::FileNode node = Node(key);
    if (!node.isMap()) Fail(key, "is no !!opencv-matrix");
    cv::Mat raw;
    try {
      node >> raw;
    } catch (const cv::Exception& error) {
      Fail(key, "is no readable !!opencv-matrix: " + Words(error));
    }
    if (raw.empty() || raw.dims != 2 || raw.channels() != 1) {
      Fail(key, "is no matrix of numbers, or an empty one (is one written as text, such as nan for .Nan?)");
    }
    cv::Mat matrix;
    raw.convertTo(matrix, CV_64F);
    for (int row = 0; row < matrix.rows; ++row) {
      for (int col = 0; col < matrix.cols; ++col) {
        const double value = matrix.at<double>(row, col);
        if (std::isfinite(value)) continue;
        Fail(key, "element [" + std::to_string(row) + "][" + std::to_string(col) + "] is " + Number(value) +
                      "; finite numbers are wanted");
      }
    }
    return matrix;
  }

  fs::path file_;
  cv::FileStorage storage_;
};

/// Largest deviation of MᵀM from the identity; +1 determinant is checked apart.
void CheckRotation(const YamlReader& yaml, const std::string& key, const cv::Matx33d& rotation, const char* part) {
  const cv::Matx33d residue = rotation.t() * rotation - cv::Matx33d::eye();
  const double worst = cv::norm(residue, cv::NORM_INF);
  if (worst > kRotationTolerance) {
    yaml.Fail(key, std::string(part) + "is no rotation: its columns are off orthonormal by " +
                       YamlReader::Number(worst) + ", at most 1e-4 is allowed");
  }
  if (cv::determinant(rotation) < 0) {
    yaml.Fail(key, std::string(part) + "is a mirroring (determinant -1); a rotation (+1) is wanted");
  }
}

cv::Matx33d CameraMatrix(const YamlReader& yaml, const std::string& key) {
  const cv::Matx33d k = yaml.Matrix(key, 3, 3);
  if (!(k(0, 0) > 0) || !(k(1, 1) > 0)) {
    yaml.Fail(key, "fx = " + YamlReader::Number(k(0, 0)) + ", fy = " + YamlReader::Number(k(1, 1)) +
                       "; focal lengths above 0 px are wanted");
  }
  if (k(0, 1) != 0 || k(1, 0) != 0 || k(2, 0) != 0 || k(2, 1) != 0 || k(2, 2) != 1) {
    yaml.Fail(key, "is no camera matrix; [fx 0 cx; 0 fy cy; 0 0 1] is wanted");
  }
  return k;
}

std::vector<double> Distortion(const YamlReader& yaml, const std::string& key) {
  return yaml.Vector(key, {4, 5, 8, 12, 14}, "4, 5, 8, 12 or 14 coefficients");
}

/// Judged by the correlations, because variances of px², rad² and m² lie many powers of ten apart.
void CheckCovariance(const YamlReader& yaml, const std::string& key, const cv::Mat& covariance) {
  const auto place = [](int row, int col) {
    return "element [" + std::to_string(row) + "][" + std::to_string(col) + "] ";
  };
  cv::Mat correlation = cv::Mat::eye(covariance.size(), CV_64F);
  for (int row = 0; row < covariance.rows; ++row) {
    const double variance = covariance.at<double>(row, row);
    if (variance < 0) yaml.Fail(key, place(row, row) + "is " + YamlReader::Number(variance) + ": a negative variance");
    for (int col = 0; col < row; ++col) {
      const double lower = covariance.at<double>(row, col), upper = covariance.at<double>(col, row);
      const double scale = std::sqrt(variance * covariance.at<double>(col, col));
      if (std::abs(lower - upper) > kCovarianceTolerance * scale) {
        yaml.Fail(key, place(row, col) + "is " + YamlReader::Number(lower) + " and its mirror image " +
                           YamlReader::Number(upper) + ": not symmetric");
      }
      if (std::abs(lower) > (1 + kCovarianceTolerance) * scale) {
        yaml.Fail(key, place(row, col) + "is " + YamlReader::Number(lower) +
                           ": more than the variances of its row and column allow");
      }
      if (scale > 0) correlation.at<double>(row, col) = correlation.at<double>(col, row) = lower / scale;
    }
  }
  cv::Mat eigenvalues;
  cv::eigen(correlation, eigenvalues);
  const double least = eigenvalues.at<double>(eigenvalues.rows - 1);
  if (least < -kCovarianceTolerance) {
    yaml.Fail(key, "has a negative variance along some direction (eigenvalue " + YamlReader::Number(least) +
                       " of its correlations): no covariance");
  }
}

void Save(const fs::path& file, const std::vector<std::pair<std::string, cv::Mat>>& matrices, cv::Size size) {
  cv::FileStorage storage(".yml", cv::FileStorage::WRITE | cv::FileStorage::MEMORY | cv::FileStorage::FORMAT_YAML);
  if (size.width > 0) storage << "image_width" << size.width << "image_height" << size.height;
  for (const auto& [key, matrix] : matrices) storage << key << matrix;
  WriteBytes(file, storage.releaseAndGetString());
}

}  // namespace

StereoCalibration LoadStereoCalibration(const fs::path& file) {
  const YamlReader yaml(file);
  StereoCalibration calibration;
  calibration.image_size = {yaml.PositiveInt("image_width"), yaml.PositiveInt("image_height")};
  calibration.K1 = CameraMatrix(yaml, "K1");
  calibration.D1 = Distortion(yaml, "D1");
  calibration.K2 = CameraMatrix(yaml, "K2");
  calibration.D2 = Distortion(yaml, "D2");
  calibration.R = yaml.Matrix("R", 3, 3);
  CheckRotation(yaml, "R", calibration.R, "");
  const std::vector<double> t = yaml.Vector("T", {3}, "3 values");
  calibration.T_m = {t[0], t[1], t[2]};
  if (calibration.Baseline_m() == 0) yaml.Fail("T", "is zero: the cameras stand apart, in metres");
  if (calibration.Baseline_m() > kLargestBaseline_m) {
    yaml.Fail("T", "is " + YamlReader::Number(calibration.Baseline_m()) +
                       " long; metres are wanted, 20 at the most (was it written in millimetres?)");
  }
  if (yaml.Has("covariance")) {
    const int count = calibration.ParameterCount();
    calibration.covariance = yaml.Matrix("covariance", count, count);
    CheckCovariance(yaml, "covariance", calibration.covariance);
  }
  return calibration;
}

void SaveStereoCalibration(const fs::path& file, const StereoCalibration& calibration) {
  std::vector<std::pair<std::string, cv::Mat>> matrices = {
      {"K1", cv::Mat(calibration.K1)}, {"D1", cv::Mat(calibration.D1, true).reshape(1, 1)},
      {"K2", cv::Mat(calibration.K2)}, {"D2", cv::Mat(calibration.D2, true).reshape(1, 1)},
      {"R", cv::Mat(calibration.R)},   {"T", cv::Mat(calibration.T_m, true)}};
  if (!calibration.covariance.empty()) matrices.emplace_back("covariance", calibration.covariance);
  Save(file, matrices, calibration.image_size);
}

RigidTransform LoadWorldFromLeft(const fs::path& file) {
  const std::string key = "T_world_left";
  const YamlReader yaml(file);
  const cv::Matx44d matrix = yaml.Matrix(key, 4, 4);
  CheckRotation(yaml, key, matrix.get_minor<3, 3>(0, 0), "its upper left 3x3 ");
  for (int col = 0; col < 4; ++col) {
    if (matrix(3, col) != (col == 3 ? 1 : 0)) yaml.Fail(key, "its last row is not 0 0 0 1: no rigid transform");
  }
  RigidTransform world_from_left;
  for (int row = 0; row < 4; ++row) {
    for (int col = 0; col < 4; ++col) world_from_left.matrix()(row, col) = matrix(row, col);
  }
  return world_from_left;
}

void SaveWorldFromLeft(const fs::path& file, const RigidTransform& world_from_left) {
  cv::Mat matrix(4, 4, CV_64F);
  for (int row = 0; row < 4; ++row) {
    for (int col = 0; col < 4; ++col) matrix.at<double>(row, col) = world_from_left.matrix()(row, col);
  }
  Save(file, {{"T_world_left", matrix}}, {});
}

}  // namespace granary
