// Each picture is a body made here, pixel by pixel, in a frame of axes and colour bar from plot.h.
#include "pipeline/pictures.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "pipeline/plot.h"

namespace granary {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr int kMapSide = 900;       // longer side of a height map, px
constexpr int kLargestBody = 1280;  // pictures from larger cameras are shrunk to this
constexpr int kMargin = 24;         // around the footprint, px
constexpr int kPolygonShift = 4;    // OpenCV's fixed-point corners: 1/16 px
constexpr int kLineEvery = 64;      // rows between the lines of a rectified pair
const cv::Scalar kInk(40, 40, 40), kOutside(255, 255, 255), kUnseen(205, 205, 205);

/// The share `low`…`high` of the finite values, so that a few outliers do not eat the colours.
std::pair<double, double> FiniteRange(const cv::Mat& values, double low, double high) {
  std::vector<float> finite;
  finite.reserve(values.total());
  for (const float value : cv::Mat_<float>(values)) {
    if (std::isfinite(value)) finite.push_back(value);
  }
  if (finite.empty()) return {0, 1};
  const auto at = [&](double share) {
    const auto nth = finite.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(finite.size() - 1));
    std::nth_element(finite.begin(), nth, finite.end());
    return static_cast<double>(*nth);
  };
  const double first = at(low), last = at(high);
  return last > first ? std::pair(first, last) : std::pair(first - 0.5, last + 0.5);
}

/// World xy to pixels of the map.
struct MapFrame {
  double px_per_m = 1, x0_m = 0, y1_m = 0;
  cv::Size size;
  [[nodiscard]] Eigen::Vector2d Pixel(const Eigen::Vector2d& world) const {
    return {(world.x() - x0_m) * px_per_m, (y1_m - world.y()) * px_per_m};
  }
};

MapFrame FrameOf(const Polygon& footprint) {
  if (footprint.empty()) throw std::invalid_argument("bin: the footprint has no corners");
  Eigen::Vector2d low = footprint.front(), high = low;
  for (const Eigen::Vector2d& corner : footprint) {
    low = low.cwiseMin(corner);
    high = high.cwiseMax(corner);
  }
  const Eigen::Vector2d extent = (high - low).cwiseMax(1e-6);
  MapFrame frame;
  frame.px_per_m = kMapSide / extent.maxCoeff();
  const double margin_m = kMargin / frame.px_per_m;
  frame.x0_m = low.x() - margin_m;
  frame.y1_m = high.y() + margin_m;
  frame.size = {static_cast<int>(std::ceil(extent.x() * frame.px_per_m)) + 2 * kMargin,
                static_cast<int>(std::ceil(extent.y() * frame.px_per_m)) + 2 * kMargin};
  return frame;
}

/// Calls `paint(pixel, w)` for the pixel centres inside the triangle, w their barycentric weights.
template <typename Paint>
void RasterTriangle(const std::array<Eigen::Vector2d, 3>& corners, cv::Size size, Paint&& paint) {
  const Eigen::Vector2d &a = corners[0], &b = corners[1], &c = corners[2];
  const double area = (b.x() - a.x()) * (c.y() - a.y()) - (c.x() - a.x()) * (b.y() - a.y());
  if (area == 0 || !std::isfinite(area)) return;
  const auto clip = [](double value, int end) { return static_cast<int>(std::clamp(value, 0.0, double(end))); };
  const int left = clip(std::floor(std::min({a.x(), b.x(), c.x()})), size.width);
  const int right = clip(std::ceil(std::max({a.x(), b.x(), c.x()})) + 1, size.width);
  const int top = clip(std::floor(std::min({a.y(), b.y(), c.y()})), size.height);
  const int bottom = clip(std::ceil(std::max({a.y(), b.y(), c.y()})) + 1, size.height);
  constexpr double kEdge = -1e-9;  // pixels on a shared edge belong to both: no seams
  for (int y = top; y < bottom; ++y) {
    for (int x = left; x < right; ++x) {
      const double wa = ((b.x() - x) * (c.y() - y) - (c.x() - x) * (b.y() - y)) / area;
      const double wb = ((c.x() - x) * (a.y() - y) - (a.x() - x) * (c.y() - y)) / area;
      const double wc = 1 - wa - wb;
      if (wa >= kEdge && wb >= kEdge && wc >= kEdge) paint(cv::Point(x, y), std::array{wa, wb, wc});
    }
  }
}

std::vector<cv::Point> FixedPointCorners(const Polygon& polygon, const MapFrame& frame) {
  std::vector<cv::Point> corners;
  for (const Eigen::Vector2d& corner : polygon) {
    const Eigen::Vector2d pixel = frame.Pixel(corner) * (1 << kPolygonShift);
    corners.emplace_back(static_cast<int>(std::lround(pixel.x())), static_cast<int>(std::lround(pixel.y())));
  }
  return corners;
}

cv::Mat PolygonMask(const Polygon& polygon, const MapFrame& frame) {
  cv::Mat mask = cv::Mat::zeros(frame.size, CV_8UC1);
  if (polygon.size() >= 3) {
    cv::fillPoly(mask, std::vector{FixedPointCorners(polygon, frame)}, cv::Scalar(255), cv::LINE_8, kPolygonShift);
  }
  return mask;
}

void Outline(cv::Mat& picture, const Polygon& polygon, const MapFrame& frame, int thickness) {
  cv::polylines(picture, std::vector{FixedPointCorners(polygon, frame)}, true, kInk, thickness, cv::LINE_AA,
                kPolygonShift);
}

void Hatch(cv::Mat& picture, const Polygon& polygon, const MapFrame& frame) {
  const cv::Mat mask = PolygonMask(polygon, frame);
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      if (mask.at<std::uint8_t>(y, x) == 0) continue;
      picture.at<cv::Vec3b>(y, x) = (x + y) % 12 < 3 ? cv::Vec3b(90, 90, 90) : cv::Vec3b(225, 225, 225);
    }
  }
  Outline(picture, polygon, frame, 1);
}

/// 8-bit BGR, stretched so that `white` is full.
cv::Mat GreyAsBgr(const cv::Mat& grey, double white) {
  cv::Mat stretched, bgr;
  grey.convertTo(stretched, CV_8U, white > 0 ? 255 / white : 0);
  cv::cvtColor(stretched, bgr, cv::COLOR_GRAY2BGR);
  return bgr;
}

/// The level that 99.9 % of the pixels do not exceed.
double White(const cv::Mat& grey) {
  cv::Mat values;
  grey.convertTo(values, CV_32F);
  return std::max(FiniteRange(values, 0, 0.999).second, 1e-6);
}

void CheckGrey(const cv::Mat& image, const char* name) {
  if (image.empty() || image.channels() != 1) {
    throw std::invalid_argument(std::string(name) + ": a picture of one channel is wanted");
  }
}

/// Shrinks what is larger than a screen; enlarges small pictures by a whole number.
cv::Mat FitBody(const cv::Mat& body, int interpolation_down) {
  const int longer = std::max(body.cols, body.rows);
  cv::Mat fitted = body;
  if (longer > kLargestBody) {
    const double scale = double(kLargestBody) / longer;
    cv::resize(body, fitted, {}, scale, scale, interpolation_down);
  } else if (const int times = 640 / std::max(1, longer); times > 1) {
    cv::resize(body, fitted, {}, times, times, cv::INTER_NEAREST);
  }
  return fitted;
}

PlotAxis Columns(const cv::Mat& image) { return {0, static_cast<double>(image.cols), "column [px]"}; }
PlotAxis Rows(const cv::Mat& image) { return {static_cast<double>(image.rows), 0, "row [px]"}; }

}  // namespace

cv::Mat HeightPicture(const Surface& surface, const Bin& bin, const std::string& title) {
  const MapFrame frame = FrameOf(bin.footprint_m);
  cv::Mat height(frame.size, CV_32FC1, cv::Scalar(kNan));
  cv::Mat completed = cv::Mat::zeros(frame.size, CV_8UC1);
  for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
    const auto& triangle = surface.triangles[i];
    std::array<Eigen::Vector2d, 3> corners;
    std::array<double, 3> heights{};
    for (std::size_t k = 0; k < 3; ++k) {
      corners[k] = frame.Pixel(surface.vertices_in_world.at(triangle[k]).head<2>());
      heights[k] = surface.height_m.at(triangle[k]);
    }
    RasterTriangle(corners, frame.size, [&](cv::Point pixel, const std::array<double, 3>& w) {
      height.at<float>(pixel) = static_cast<float>(w[0] * heights[0] + w[1] * heights[1] + w[2] * heights[2]);
      completed.at<std::uint8_t>(pixel) = surface.triangle_interpolated.at(i);
    });
  }
  const auto [low, high] = FiniteRange(height, 0.002, 0.998);
  // A flat surface would show its noise as mountains: never spread the colours over less than 1 % of the bin's height.
  const double least = std::max(0.01 * bin.height_m, 1e-4);
  const double widen = std::max(0.0, least - (high - low)) / 2;
  const ColourBar bar{low - widen, high + widen, "grain height over the floor [m]", cv::COLORMAP_VIRIDIS};

  cv::Mat body = Colourise(height, bar);
  const cv::Mat inside = PolygonMask(bin.footprint_m, frame);
  for (int y = 0; y < body.rows; ++y) {
    for (int x = 0; x < body.cols; ++x) {
      auto& pixel = body.at<cv::Vec3b>(y, x);
      const bool seen = std::isfinite(height.at<float>(y, x));
      if (!seen && inside.at<std::uint8_t>(y, x) == 0) pixel = {255, 255, 255};
      if (seen && completed.at<std::uint8_t>(y, x) != 0 && x % 6 < 2 && y % 6 < 2) pixel = {255, 255, 255};
    }
  }
  for (const Polygon& polygon : bin.exclude_m) Hatch(body, polygon, frame);
  Outline(body, bin.footprint_m, frame, 2);
  const PlotAxis x{frame.x0_m, frame.x0_m + frame.size.width / frame.px_per_m, "x [m]"};
  const PlotAxis y{frame.y1_m - frame.size.height / frame.px_per_m, frame.y1_m, "y [m]"};
  cv::Mat picture = FramePlot(body, title, x, y, bar);
  cv::copyMakeBorder(picture, picture, 0, 30, 0, 0, cv::BORDER_CONSTANT, kOutside);
  const std::string key = bin.exclude_m.empty()
                              ? "dotted: completed, not measured    grey: no grain surface"
                              : "dotted: completed, not measured    grey: no grain surface    hatched: excluded";
  DrawCentredText(picture, key, {picture.cols / 2, picture.rows - 20}, kInk);
  return picture;
}

cv::Mat DisparityPicture(const cv::Mat& disparity_px, const std::string& title) {
  if (disparity_px.type() != CV_32FC1 || disparity_px.empty()) {
    throw std::invalid_argument("disparity: one float channel is wanted");
  }
  const auto [low, high] = FiniteRange(disparity_px, 0.005, 0.995);
  const ColourBar bar{low, high, "disparity [px]", cv::COLORMAP_TURBO};
  // Nearest, so that no colour is mixed of a surface and what lies behind it.
  const cv::Mat body = FitBody(Colourise(disparity_px, bar), cv::INTER_NEAREST);
  return FramePlot(body, title, Columns(disparity_px), Rows(disparity_px), bar);
}

cv::Mat RectifiedPicture(const cv::Mat& left, const cv::Mat& right) {
  CheckGrey(left, "left");
  CheckGrey(right, "right");
  if (left.size() != right.size()) throw std::invalid_argument("rectified pair: both must have one size");
  const double white = std::max(White(left), White(right));
  constexpr int kSeam = 8;
  cv::Mat body(left.rows, 2 * left.cols + kSeam, CV_8UC3, kOutside);
  GreyAsBgr(left, white).copyTo(body.colRange(0, left.cols));
  GreyAsBgr(right, white).copyTo(body.colRange(left.cols + kSeam, body.cols));
  for (int row = kLineEvery; row < body.rows; row += kLineEvery) {
    const bool even = row / kLineEvery % 2 == 0;  // two colours, so that the eye does not slip to the next line
    cv::line(body, {0, row}, {body.cols - 1, row}, even ? cv::Scalar(80, 220, 80) : cv::Scalar(60, 180, 255), 1);
  }
  return FramePlot(body, "Rectified pair: left | right, a line every 64 rows", std::nullopt, Rows(left), std::nullopt);
}

cv::Mat MaskPicture(const cv::Mat& left, const cv::Mat& grain_mask, const std::string& title) {
  CheckGrey(left, "left");
  if (grain_mask.type() != CV_8UC1 || grain_mask.size() != left.size()) {
    throw std::invalid_argument("grain mask: CV_8UC1 of the picture's size is wanted");
  }
  cv::Mat picture = GreyAsBgr(left, White(left));
  for (int row = 0; row < picture.rows; ++row) {
    for (int col = 0; col < picture.cols; ++col) {
      if (grain_mask.at<std::uint8_t>(row, col) == 0) continue;
      auto& pixel = picture.at<cv::Vec3b>(row, col);
      const int grey = pixel[0];
      // Amber over the picture's own light, so that the speckle stays visible.
      pixel = {static_cast<std::uint8_t>(grey * 3 / 10), static_cast<std::uint8_t>(60 + grey * 6 / 10),
               static_cast<std::uint8_t>(105 + grey * 15 / 100 * 3)};
    }
  }
  return FramePlot(FitBody(picture, cv::INTER_AREA), title, Columns(left), Rows(left), std::nullopt);
}

}  // namespace granary
