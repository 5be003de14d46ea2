// OpenCV's iteration in double does the inversion; projecting back shows whether it converged.
#include "drivers/sim/optics.h"

#include <stdexcept>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <opencv2/calib3d.hpp>

namespace granary {
namespace {

std::vector<cv::Point2d> Undistort(const Optics& optics, const std::vector<cv::Point2d>& pixels) {
  std::vector<cv::Point2d> rays;
  const cv::TermCriteria until(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 100, 1e-7);
  cv::undistortPoints(pixels, rays, optics.K, optics.D, cv::noArray(), cv::noArray(), until);
  return rays;
}

}  // namespace

Eigen::Vector2d RayOf(const Optics& optics, const cv::Point2d& pixel) {
  const cv::Point2d ray = Undistort(optics, {pixel})[0];
  return {ray.x, ray.y};
}

cv::Mat RaysOfPixels(const Optics& optics, const std::string& name) {
  cv::Mat rays(optics.size, CV_32FC2);
  tbb::parallel_for(tbb::blocked_range<int>(0, rays.rows, 16), [&](const tbb::blocked_range<int>& rows) {
    std::vector<cv::Point2d> pixels(rays.cols);
    for (int y = rows.begin(); y < rows.end(); ++y) {
      for (int x = 0; x < rays.cols; ++x) pixels[x] = cv::Point2d(x, y);
      const auto line = Undistort(optics, pixels);
      for (int x = 0; x < rays.cols; ++x) {
        rays.at<cv::Vec2f>(y, x) = {static_cast<float>(line[x].x), static_cast<float>(line[x].y)};
      }
    }
  });

  std::vector<cv::Point2d> pixels;
  std::vector<cv::Point3d> points;
  for (int j = 0; j <= 32; ++j) {
    for (int i = 0; i <= 32; ++i) {
      const int x = (rays.cols - 1) * i / 32, y = (rays.rows - 1) * j / 32;
      const auto& ray = rays.at<cv::Vec2f>(y, x);
      pixels.emplace_back(x, y);
      points.emplace_back(ray[0], ray[1], 1.0);
    }
  }
  std::vector<cv::Point2d> back;
  cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), optics.K, optics.D, back);
  for (std::size_t k = 0; k < pixels.size(); ++k) {
    if (!(cv::norm(back[k] - pixels[k]) < 2e-3)) {
      throw std::invalid_argument("calibration: the distortion of the " + name + " camera cannot be undone at pixel (" +
                                  std::to_string(static_cast<int>(pixels[k].x)) + ", " +
                                  std::to_string(static_cast<int>(pixels[k].y)) +
                                  "); allowed are lenses that map the picture one to one");
    }
  }
  return rays;
}

}  // namespace granary
