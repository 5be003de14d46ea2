// Parallel projection with a depth buffer, drawn at twice the size: a triangle is smaller than a pixel, and the mean of
// four shades is quieter than one.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "pipeline/pictures.h"
#include "pipeline/plot.h"
#include "pipeline/raster_triangle.h"

namespace granary {
namespace {

constexpr double kTurn = 28 * std::numbers::pi / 180;       // about the vertical: two walls come into view
constexpr double kElevation = 38 * std::numbers::pi / 180;  // of the eye above the floor
constexpr int kWidth = 1000, kMargin = 24;                  // of the body, px
constexpr int kOversampling = 2;
constexpr float kNothing = std::numeric_limits<float>::infinity();

/// The world as the eye sees it, pixels of the oversampled picture, and the depth buffer.
class View {
 public:
  explicit View(const Bin& bin) {
    if (bin.footprint_m.empty()) throw std::invalid_argument("bin: the footprint has no corners");
    const Eigen::Vector3d ahead(-std::sin(kTurn), std::cos(kTurn), 0), up(0, 0, 1);
    axes_.row(0) = Eigen::Vector3d(std::cos(kTurn), std::sin(kTurn), 0);
    axes_.row(1) = -(std::sin(kElevation) * ahead + std::cos(kElevation) * up);  // rows run downwards
    axes_.row(2) = std::cos(kElevation) * ahead - std::sin(kElevation) * up;     // away from the eye
    Eigen::AlignedBox2d box;
    for (const Eigen::Vector2d& corner : bin.footprint_m) {
      for (const double z : {0.0, bin.height_m}) {
        box.extend((axes_ * Eigen::Vector3d(corner.x(), corner.y(), z)).head<2>());
      }
    }
    const Eigen::Vector2d extent = box.sizes().cwiseMax(1e-6);
    px_per_m_ = kOversampling * (kWidth - 2.0 * kMargin) / extent.maxCoeff();
    const double margin = kOversampling * kMargin;
    shift_ = Eigen::Vector2d::Constant(margin) - px_per_m_ * box.min();
    const cv::Size size(static_cast<int>(std::ceil(px_per_m_ * extent.x() + 2 * margin)),
                        static_cast<int>(std::ceil(px_per_m_ * extent.y() + 2 * margin)));
    colours_ = cv::Mat(size, CV_8UC3, cv::Scalar(255, 255, 255));
    depth_ = cv::Mat(size, CV_32FC1, cv::Scalar(kNothing));
  }

  /// Column and row, px, and the depth, m.
  [[nodiscard]] Eigen::Vector3d Project(const Eigen::Vector3d& world) const {
    const Eigen::Vector3d seen = axes_ * world;
    return {px_per_m_ * seen.x() + shift_.x(), px_per_m_ * seen.y() + shift_.y(), seen.z()};
  }

  /// Where a metre along `world` leads in the picture, columns and rows; at most 1 long.
  [[nodiscard]] Eigen::Vector2d Direction(const Eigen::Vector3d& world) const { return (axes_ * world).head<2>(); }

  void DrawTriangle(const std::array<Eigen::Vector3d, 3>& corners, const Rgb& colour) {
    // A light from the left and the front; half of it goes round the slopes that face away, so that none turns black.
    static const Eigen::Vector3d light = Eigen::Vector3d(-0.55, -0.35, 0.75).normalized();
    const Eigen::Vector3d normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized();
    const double shade = 0.2 + 0.9 * (0.5 + 0.5 * normal.dot(light));
    cv::Vec3b bgr;
    for (int i = 0; i < 3; ++i) {
      bgr[i] = cv::saturate_cast<std::uint8_t>(shade * colour[static_cast<std::size_t>(2 - i)]);
    }
    std::array<Eigen::Vector2d, 3> places;
    std::array<double, 3> depths{};
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3d seen = Project(corners[k]);
      places[k] = seen.head<2>();
      depths[k] = seen.z();
    }
    RasterTriangle(places, colours_.size(), [&](cv::Point pixel, const std::array<double, 3>& w) {
      const auto depth = static_cast<float>(w[0] * depths[0] + w[1] * depths[1] + w[2] * depths[2]);
      if (depth >= depth_.at<float>(pixel)) return;
      depth_.at<float>(pixel) = depth;
      colours_.at<cv::Vec3b>(pixel) = bgr;
    });
  }

  /// Dashed where the surface hides it.
  void DrawEdge(const Eigen::Vector3d& from, const Eigen::Vector3d& to, std::uint8_t grey) {
    const Eigen::Vector3d start = Project(from), end = Project(to);
    const int steps = std::max(1, static_cast<int>((end - start).head<2>().norm()));
    const double slack_m = 3 / px_per_m_;  // an edge that the surface touches is in sight
    for (int i = 0; i <= steps; ++i) {
      const Eigen::Vector3d at = start + (end - start) * (static_cast<double>(i) / steps);
      const cv::Rect dot = cv::Rect(cvRound(at.x()) - 1, cvRound(at.y()) - 1, 3, 3) & cv::Rect({}, colours_.size());
      for (int y = dot.y; y < dot.br().y; ++y) {
        for (int x = dot.x; x < dot.br().x; ++x) {
          const bool hidden = depth_.at<float>(y, x) < at.z() - slack_m;
          if (hidden && i / 12 % 2 == 0) continue;  // dashed
          colours_.at<cv::Vec3b>(y, x) = cv::Vec3b::all(hidden ? 110 : grey);
        }
      }
    }
  }

  [[nodiscard]] cv::Mat Picture() const {
    cv::Mat picture;
    cv::resize(colours_, picture, colours_.size() / kOversampling, 0, 0, cv::INTER_AREA);
    return picture;
  }

 private:
  Eigen::Matrix3d axes_;
  double px_per_m_ = 1;
  Eigen::Vector2d shift_{0, 0};
  cv::Mat colours_, depth_;
};

void DrawWalls(View& view, const Polygon& polygon, double height_m, std::uint8_t grey) {
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    const auto at = [](const Eigen::Vector2d& place, double z) { return Eigen::Vector3d(place.x(), place.y(), z); };
    view.DrawEdge(at(a, 0), at(b, 0), grey);
    view.DrawEdge(at(a, height_m), at(b, height_m), grey);
    view.DrawEdge(at(a, 0), at(a, height_m), grey);
  }
}

/// The directions of the world's axes, in the empty lower left corner.
void DrawAxes(cv::Mat& picture, const View& view) {
  constexpr double kLength_px = 36;
  const cv::Point origin(kMargin + 14, picture.rows - kMargin - 6);
  const std::array<const char*, 3> names{"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector2d tip = kLength_px * view.Direction(Eigen::Vector3d::Unit(axis));
    const auto at = [&](double length) {
      return origin + cv::Point(cvRound(length * tip.x()), cvRound(length * tip.y()));
    };
    cv::arrowedLine(picture, origin, at(1), kInk, 1, cv::LINE_AA, 0, 0.2);
    DrawCentredText(picture, names[static_cast<std::size_t>(axis)], at(1.35), kInk);
  }
}

/// "measured: 95.3 % of the surface", counted in floor area.
std::string Share(const char* name, double part_m2, double whole_m2) {
  char text[64];
  std::snprintf(text, sizeof text, "%s: %.1f %% of the surface", name, whole_m2 > 0 ? 100 * part_m2 / whole_m2 : 0.0);
  return text;
}

}  // namespace

cv::Mat MeshPicture(const Surface& surface, const Bin& bin, const std::string& title) {
  View view(bin);
  std::array<double, 2> area_m2{};
  for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
    std::array<Eigen::Vector3d, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) corners[k] = surface.vertices_in_world.at(surface.triangles[i][k]);
    const bool completed = surface.triangle_interpolated.at(i) != 0;
    view.DrawTriangle(corners, completed ? kCompletedColour : kMeasuredColour);
    area_m2[completed ? 1 : 0] += std::abs((corners[1] - corners[0]).cross(corners[2] - corners[0]).z()) / 2;
  }
  for (const Polygon& polygon : bin.exclude_m) DrawWalls(view, polygon, bin.height_m, 140);
  DrawWalls(view, bin.footprint_m, bin.height_m, 40);
  cv::Mat body = view.Picture();
  DrawAxes(body, view);
  const double whole_m2 = area_m2[0] + area_m2[1];
  const std::array<LegendEntry, 2> legend{{{kMeasuredColour, Share("measured", area_m2[0], whole_m2)},
                                           {kCompletedColour, Share("completed", area_m2[1], whole_m2)}}};
  return AppendLegend(FramePlot(body, title, std::nullopt, std::nullopt, std::nullopt), legend);
}

}  // namespace granary
