// The pipeline keeps no reasons for single points; the bin's geometry tells enough of them apart for a person.
#include "pipeline/removed.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>

#include <opencv2/core.hpp>

#include "pipeline/floor.h"

namespace granary {
namespace {

/// How far the kept points stay clear of the edges, but for a thousandth of them; 0 when none was kept.
double EdgeMargin_m(const cv::Mat& points, const cv::Mat& mask, const Bin& bin) {
  std::vector<double> distances;
  for (int y = 0; y < mask.rows; y += 2) {
    for (int x = 0; x < mask.cols; x += 2) {
      if (mask.at<std::uint8_t>(y, x) == 0) continue;
      const auto& p = points.at<cv::Vec3f>(y, x);
      distances.push_back(DistanceToEdge_m(bin, {p[0], p[1]}));
    }
  }
  if (distances.empty()) return 0;
  const auto nth = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 1000);
  std::nth_element(distances.begin(), nth, distances.end());
  return *nth;
}

}  // namespace

RemovedPoints FindRemoved(const cv::Mat& points, const cv::Mat& mask, const Bin& bin) {
  if (points.type() != CV_32FC3) throw std::invalid_argument("points: CV_32FC3 is wanted");
  if (mask.type() != CV_8UC1 || mask.size() != points.size()) {
    throw std::invalid_argument("grain mask: CV_8UC1 of the points' size is wanted");
  }
  const double margin_m = EdgeMargin_m(points, mask, bin);
  RemovedPoints out;
  for (int y = 0; y < points.rows; ++y) {
    for (int x = 0; x < points.cols; ++x) {
      const auto& p = points.at<cv::Vec3f>(y, x);
      if (!std::isfinite(p[2]) || mask.at<std::uint8_t>(y, x) != 0) continue;
      const Eigen::Vector2d place(p[0], p[1]);
      const bool near_edge = DistanceToEdge_m(bin, place) <= margin_m;
      Removal why = Removal::kObject;
      if (near_edge) {
        why = Removal::kWall;
      } else if (!IsGrainFloor(bin, place)) {
        why = Removal::kOutside;
      } else if (p[2] > bin.height_m) {
        why = Removal::kAboveBin;
      }
      out.points_in_world.emplace_back(p[0], p[1], p[2]);
      out.why.push_back(why);
    }
  }
  return out;
}

Rgb ColourOf(Removal why) {
  switch (why) {
    case Removal::kOutside:
      return kOutsideColour;
    case Removal::kWall:
      return kWallColour;
    case Removal::kAboveBin:
      return kAboveColour;
    case Removal::kObject:
      return kObjectColour;
  }
  throw std::logic_error("unknown reason of removal");
}

}  // namespace granary
