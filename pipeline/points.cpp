#include "pipeline/points.h"

#include <cmath>
#include <limits>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace granary {

cv::Mat PointsInWorld(const cv::Mat& disparity_px, const Rectification& rectification,
                      const RigidTransform& world_from_left) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  cv::Mat points(disparity_px.size(), CV_32FC3, cv::Scalar::all(nan));
  const RigidTransform world_from_rectified = world_from_left * rectification.left_from_rectified;
  tbb::parallel_for(tbb::blocked_range<int>(0, disparity_px.rows, 16), [&](const tbb::blocked_range<int>& rows) {
    for (int y = rows.begin(); y < rows.end(); ++y) {
      const float* disparity = disparity_px.ptr<float>(y);
      cv::Vec3f* out = points.ptr<cv::Vec3f>(y);
      for (int x = 0; x < disparity_px.cols; ++x) {
        if (!std::isfinite(disparity[x])) continue;
        const double z = rectification.Depth_m(disparity[x]);
        if (!(z > 0) || !std::isfinite(z)) continue;
        const Eigen::Vector3d point =
            world_from_rectified * Eigen::Vector3d(z * (x - rectification.left_cx_px) / rectification.focal_px,
                                                   z * (y - rectification.cy_px) / rectification.focal_px, z);
        out[x] = {static_cast<float>(point.x()), static_cast<float>(point.y()), static_cast<float>(point.z())};
      }
    }
  });
  return points;
}

cv::Mat PointNoise_m(const cv::Mat& disparity_px, const cv::Mat& deviation_px, const Rectification& rectification) {
  cv::Mat noise(disparity_px.size(), CV_32FC1);
  for (int y = 0; y < noise.rows; ++y) {
    for (int x = 0; x < noise.cols; ++x) {
      const float d = disparity_px.at<float>(y, x);
      noise.at<float>(y, x) =
          std::isfinite(d)
              ? static_cast<float>(rectification.DepthStep_m(rectification.Depth_m(d))) * deviation_px.at<float>(y, x)
              : std::numeric_limits<float>::quiet_NaN();
    }
  }
  return noise;
}

}  // namespace granary
