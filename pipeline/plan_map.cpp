// Corners go to OpenCV in sixteenths of a pixel, so that slanted edges do not jitter against the map's values.
#include "pipeline/plan_map.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include <opencv2/imgproc.hpp>

namespace granary {
namespace {

constexpr int kMapSide = 900;     // longer side of the footprint, px
constexpr int kPolygonShift = 4;  // OpenCV's fixed-point corners: 1/16 px

std::vector<cv::Point> FixedPointCorners(const Polygon& polygon, const PlanMap& map) {
  std::vector<cv::Point> corners;
  for (const Eigen::Vector2d& corner : polygon) {
    const Eigen::Vector2d pixel = map.Pixel(corner) * (1 << kPolygonShift);
    corners.emplace_back(static_cast<int>(std::lround(pixel.x())), static_cast<int>(std::lround(pixel.y())));
  }
  return corners;
}

}  // namespace

PlanMap FitPlan(const Polygon& footprint, int margin_px) {
  if (footprint.empty()) throw std::invalid_argument("bin: the footprint has no corners");
  const Eigen::AlignedBox2d box = Bounds(footprint);
  const Eigen::Vector2d extent = box.sizes().cwiseMax(1e-6);
  PlanMap map;
  map.px_per_m = kMapSide / extent.maxCoeff();
  map.x0_m = box.min().x() - margin_px / map.px_per_m;
  map.y1_m = box.max().y() + margin_px / map.px_per_m;
  map.size = {static_cast<int>(std::ceil(extent.x() * map.px_per_m)) + 2 * margin_px,
              static_cast<int>(std::ceil(extent.y() * map.px_per_m)) + 2 * margin_px};
  return map;
}

cv::Mat PolygonMask(const Polygon& polygon, const PlanMap& map) {
  cv::Mat mask = cv::Mat::zeros(map.size, CV_8UC1);
  if (polygon.size() >= 3) {
    cv::fillPoly(mask, std::vector{FixedPointCorners(polygon, map)}, cv::Scalar(255), cv::LINE_8, kPolygonShift);
  }
  return mask;
}

void OutlinePolygon(cv::Mat& picture, const Polygon& polygon, const PlanMap& map, int thickness_px) {
  cv::polylines(picture, std::vector{FixedPointCorners(polygon, map)}, true, kInk, thickness_px, cv::LINE_AA,
                kPolygonShift);
}

void HatchPolygon(cv::Mat& picture, const Polygon& polygon, const PlanMap& map) {
  const cv::Mat mask = PolygonMask(polygon, map);
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      if (mask.at<std::uint8_t>(y, x) == 0) continue;
      picture.at<cv::Vec3b>(y, x) = (x + y) % 12 < 3 ? cv::Vec3b(90, 90, 90) : cv::Vec3b(225, 225, 225);
    }
  }
  OutlinePolygon(picture, polygon, map, 1);
}

}  // namespace granary
