// Points as dots on the plan, the rarer kinds later and larger: a cable is a few hundred points among a million.
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "pipeline/pictures.h"
#include "pipeline/plan_map.h"
#include "pipeline/plot.h"

namespace granary {
namespace {

constexpr int kMargin = 90;  // around the footprint, px: walls lean outwards as the camera sees them

struct Kind {
  Removal why;
  const char* name;
  int dot_px;
};
constexpr std::array<Kind, 4> kKinds{{{Removal::kOutside, "outside the bin", 1},
                                      {Removal::kWall, "wall or pillar and the strip along it", 1},
                                      {Removal::kObject, "beam, cable, stray point", 2},
                                      {Removal::kAboveBin, "above the bin", 2}}};

void Dot(cv::Mat& body, const PlanMap& map, float x, float y, const Rgb& colour, int dot_px) {
  const Eigen::Vector2d pixel = map.Pixel({x, y});
  if (!(pixel.cwiseAbs().maxCoeff() < 1e6)) return;
  const cv::Rect dot = cv::Rect(cvRound(pixel.x()), cvRound(pixel.y()), dot_px, dot_px) & cv::Rect({}, body.size());
  if (!dot.empty()) body(dot).setTo(Bgr(colour));
}

std::string Counted(const char* name, std::size_t count) {
  char text[96];
  std::snprintf(text, sizeof text, "%s: %zu", name, count);
  return text;
}

}  // namespace

cv::Mat RemovedPicture(const cv::Mat& points, const cv::Mat& mask, const RemovedPoints& removed, const Bin& bin,
                       const std::string& title) {
  const PlanMap map = FitPlan(bin.footprint_m, kMargin);
  cv::Mat body(map.size, CV_8UC3, cv::Scalar(255, 255, 255));
  std::size_t kept = 0;
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      if (mask.at<std::uint8_t>(y, x) == 0) continue;
      const auto& p = points.at<cv::Vec3f>(y, x);
      Dot(body, map, p[0], p[1], kKeptColour, 2);
      ++kept;
    }
  }
  std::vector<LegendEntry> legend{{kKeptColour, Counted("kept", kept)}};
  for (const Kind& kind : kKinds) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < removed.why.size(); ++i) {
      if (removed.why[i] != kind.why) continue;
      Dot(body, map, removed.points_in_world[i].x(), removed.points_in_world[i].y(), ColourOf(kind.why), kind.dot_px);
      ++count;
    }
    if (count > 0) legend.push_back({ColourOf(kind.why), Counted(kind.name, count)});
  }
  for (const Polygon& polygon : bin.exclude_m) OutlinePolygon(body, polygon, map, 2);
  OutlinePolygon(body, bin.footprint_m, map, 2);
  return AppendLegend(FramePlot(body, title, map.XAxis(), map.YAxis(), std::nullopt), legend);
}

}  // namespace granary
