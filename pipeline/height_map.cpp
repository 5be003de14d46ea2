// The map is the surface's own triangles, drawn pixel by pixel; only the contour lines come from a smoothed copy.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "pipeline/contours.h"
#include "pipeline/pictures.h"
#include "pipeline/plan_map.h"
#include "pipeline/plot.h"
#include "pipeline/raster_triangle.h"

namespace granary {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr int kMargin = 24;  // around the footprint, px
// A flat surface would show its noise as mountains: the colours are never spread over less than this share of the bin's
// height.
constexpr double kLeastRange = 0.01;
constexpr double kSmooth_px = 10;            // 1 % of the map: kernels vanish, dunes stay
constexpr double kNoiseIntervals = 6;        // an interval in deviations of what noise the smoothed copy still has
constexpr int kContours = 14;                // no more than about so many
constexpr double kShortestContour_px = 120;  // shorter ones are single bumps
constexpr double kShortestLabelled_px = 240;
constexpr int kLabelPad = 4;
const cv::Scalar kWhite(255, 255, 255);

struct HeightMap {
  cv::Mat height_m;   ///< CV_32FC1, NaN where there is no surface
  cv::Mat completed;  ///< CV_8UC1, 1 where completed
};

HeightMap RasterHeights(const Surface& surface, const PlanMap& map) {
  HeightMap out{cv::Mat(map.size, CV_32FC1, cv::Scalar(kNan)), cv::Mat::zeros(map.size, CV_8UC1)};
  for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
    const auto& triangle = surface.triangles[i];
    std::array<Eigen::Vector2d, 3> corners;
    std::array<double, 3> heights{};
    for (std::size_t k = 0; k < 3; ++k) {
      corners[k] = map.Pixel(surface.vertices_in_world.at(triangle[k]).head<2>());
      heights[k] = surface.height_m.at(triangle[k]);
    }
    RasterTriangle(corners, map.size, [&](cv::Point pixel, const std::array<double, 3>& w) {
      out.height_m.at<float>(pixel) = static_cast<float>(w[0] * heights[0] + w[1] * heights[1] + w[2] * heights[2]);
      out.completed.at<std::uint8_t>(pixel) = surface.triangle_interpolated.at(i);
    });
  }
  return out;
}

/// A Gaussian mean over what is finite; NaN stays.
cv::Mat Smooth(const cv::Mat& values, double sigma_px) {
  const cv::Mat finite = values == values;
  cv::Mat weight, filled = cv::Mat::zeros(values.size(), CV_32FC1), smooth;
  finite.convertTo(weight, CV_32F, 1.0 / 255);
  values.copyTo(filled, finite);
  cv::GaussianBlur(filled, filled, {}, sigma_px, sigma_px, cv::BORDER_ISOLATED | cv::BORDER_CONSTANT);
  cv::GaussianBlur(weight, weight, {}, sigma_px, sigma_px, cv::BORDER_ISOLATED | cv::BORDER_CONSTANT);
  cv::divide(filled, weight, smooth);
  smooth.setTo(kNan, ~finite);
  return smooth;
}

/// Where a label breaks a line, and how well it lies there.
struct Spot {
  cv::Rect place;
  double score = -1;
};

/// The most level stretch of the line that keeps the label on the surface and clear of other labels.
Spot FindSpot(const ContourLine& line, cv::Size text, const cv::Mat& surface_mask, const std::vector<cv::Rect>& taken) {
  const auto& points = line.points_px;
  const auto half = static_cast<std::size_t>(text.width / 2);
  Spot best;
  for (std::size_t i = half; i + half < points.size(); i += 4) {
    const cv::Point centre = points[i];
    const cv::Rect place(centre.x - text.width / 2 - kLabelPad, centre.y - text.height / 2 - kLabelPad,
                         text.width + 2 * kLabelPad, text.height + 2 * kLabelPad);
    if ((place & cv::Rect({}, surface_mask.size())) != place) continue;
    if (cv::countNonZero(surface_mask(place)) != place.area()) continue;
    const bool clear =
        std::none_of(taken.begin(), taken.end(), [&](const cv::Rect& other) { return (other & place).area() > 0; });
    const double score = std::abs(points[i + half].x - points[i - half].x);
    if (clear && score > best.score) best = {place, score};
  }
  return best;
}

/// Draws the lines of the smoothed heights and their labels. @return what the lines are, for the reader
std::string DrawContours(cv::Mat& body, const cv::Mat& height_m, const ColourBar& bar, double height_of_bin_m) {
  // Single kernels and the noise would make a tangle of each line. Smoothed for the lines only: the colours, and every
  // figure, are those of the surface itself.
  const cv::Mat smooth = Smooth(height_m, kSmooth_px);
  const auto [low, high] = FiniteRange(smooth, 0, 1);
  const cv::Mat rest = cv::abs(smooth - Smooth(height_m, 2 * kSmooth_px));
  const double noise_m = 1.48 * FiniteRange(rest, 0, 0.5).second;  // by the median: crests and toes do not count
  const double least_m = std::max(kNoiseIntervals * noise_m, kLeastRange * height_of_bin_m / 5);
  const ContourLevels chosen = ChooseContourLevels(low, high, kContours, least_m);
  const cv::Mat plain = body.clone(), surface_mask = smooth == smooth;
  std::vector<cv::Rect> taken;
  bool any = false;
  for (const double level : chosen.levels) {
    if (level < chosen.interval / 2) continue;  // a line at 0 would follow the noise of bare floor
    const cv::Mat shade = Colourise(cv::Mat(1, 1, CV_32FC1, cv::Scalar(level)), bar);
    const auto& bgr = shade.at<cv::Vec3b>(0, 0);
    const cv::Scalar colour = 0.1 * bgr[0] + 0.6 * bgr[1] + 0.3 * bgr[2] > 110 ? kInk : kWhite;
    for (const ContourLine& line : TraceContours(smooth, level)) {
      const double length_px = cv::arcLength(line.points_px, line.closed);
      if (length_px < kShortestContour_px) continue;
      any = true;
      std::vector<cv::Point> drawn;
      for (const cv::Point2f& point : line.points_px) drawn.emplace_back(cvRound(16 * point.x), cvRound(16 * point.y));
      cv::polylines(body, std::vector{drawn}, line.closed, colour, 1, cv::LINE_AA, 4);
      if (length_px < kShortestLabelled_px) continue;
      const std::string text = RoundText(level, chosen.interval);
      const Spot spot = FindSpot(line, TextSize(text), surface_mask, taken);
      if (spot.score < 0) continue;
      taken.push_back(spot.place);
      plain(spot.place).copyTo(body(spot.place));
      DrawCentredText(body, text, {spot.place.x + spot.place.width / 2, spot.place.y + spot.place.height / 2}, colour);
    }
  }
  if (!any) return "no lines: too flat    ";
  char text[64];
  std::snprintf(text, sizeof text, "lines: every %.4g m    ", chosen.interval);
  return text;
}

}  // namespace

cv::Mat HeightPicture(const Surface& surface, const Bin& bin, const std::string& title) {
  const PlanMap map = FitPlan(bin.footprint_m, kMargin);
  const auto [height_m, completed] = RasterHeights(surface, map);
  const auto [low, high] = FiniteRange(height_m, 0.002, 0.998);
  const double least = std::max(kLeastRange * bin.height_m, 1e-4);
  const double widen = std::max(0.0, least - (high - low)) / 2;
  const ColourBar bar{low - widen, high + widen, "grain height over the floor [m]", cv::COLORMAP_VIRIDIS};

  cv::Mat body = Colourise(height_m, bar);
  const cv::Mat inside = PolygonMask(bin.footprint_m, map);
  for (int y = 0; y < body.rows; ++y) {
    for (int x = 0; x < body.cols; ++x) {
      auto& pixel = body.at<cv::Vec3b>(y, x);
      const bool seen = std::isfinite(height_m.at<float>(y, x));
      if (!seen && inside.at<std::uint8_t>(y, x) == 0) pixel = {255, 255, 255};
      if (seen && completed.at<std::uint8_t>(y, x) != 0 && x % 6 < 2 && y % 6 < 2) pixel = {255, 255, 255};
    }
  }
  std::string key = DrawContours(body, height_m, bar, bin.height_m);
  for (const Polygon& polygon : bin.exclude_m) HatchPolygon(body, polygon, map);
  OutlinePolygon(body, bin.footprint_m, map, 3);
  cv::Mat picture = FramePlot(body, title, map.XAxis(), map.YAxis(), bar);
  cv::copyMakeBorder(picture, picture, 0, 30, 0, 0, cv::BORDER_CONSTANT, kWhite);
  key += "dotted: completed, not measured    grey: no grain surface";
  if (!bin.exclude_m.empty()) key += "    hatched: excluded";
  DrawCentredText(picture, key, {picture.cols / 2, picture.rows - 20}, kInk);
  return picture;
}

}  // namespace granary
