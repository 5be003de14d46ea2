// A thing that moves is at another depth in each shot; grain at rest is where it was to a few hundredths of a pixel.
#include "pipeline/rig_shots.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "pipeline/points.h"
#include "pipeline/shots.h"
#include "pipeline/text.h"

namespace granary {

namespace {

// Of the pixels that show the bin; a person covers several times as much in a store 12 m wide.
constexpr double kMaxMovedShare = 0.001;

Verdict JudgeMotion(const cv::Mat& moved, const std::vector<cv::Mat>& disparities, const RigGeometry& geometry,
                    const Bin& bin) {
  const Eigen::AlignedBox2d box = Bounds(bin.footprint_m);
  cv::Mat counted = cv::Mat::zeros(moved.size(), CV_8UC1);  // pixels that show the bin in any of the shots
  double in_bin = 0, moving = 0;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const cv::Mat& disparity : disparities) {
    const cv::Mat points = PointsInWorld(disparity, geometry.rectification, geometry.setup.world_from_left);
    for (int y = 0; y < moved.rows; ++y) {
      for (int x = 0; x < moved.cols; ++x) {
        const auto& p = points.at<cv::Vec3f>(y, x);
        const Eigen::Vector2d place(p[0], p[1]);
        auto& done = counted.at<std::uint8_t>(y, x);
        if (done || !std::isfinite(p[2]) || !box.contains(place)) continue;
        done = 1;
        ++in_bin;
        if (moved.at<std::uint8_t>(y, x) == 0) continue;
        ++moving;
        sum += place;
      }
    }
  }
  if (moving <= kMaxMovedShare * in_bin) return {};
  const Eigen::Vector2d where = sum / moving;
  return {Reason::kSceneMoving, FormatText("%.1f %% of the bin is not the same in all shots, at most %.1f %%; ",
                                           100 * moving / in_bin, 100 * kMaxMovedShare) +
                                    FormatText("around x = %.2f m, y = %.2f m", where.x(), where.y())};
}

}  // namespace

RigShots MakeCloudOfShots(const RigGeometry& geometry, const Bin& bin, const std::vector<Shot>& shots, std::size_t rig,
                          const PipelineOptions& options, Laps& laps, StageTimings_ms& timings) {
  RigShots out;
  std::vector<cv::Mat> deviations;
  for (std::size_t k = 0; k < shots.size(); ++k) {
    RigCloud cloud = MakeCloud(geometry, shots[k][rig], options, laps, timings);
    if (k > 0) {
      cloud.quality.mean_fraction = std::min(cloud.quality.mean_fraction, out.cloud.quality.mean_fraction);
      cloud.quality.speckle_contrast = std::min(cloud.quality.speckle_contrast, out.cloud.quality.speckle_contrast);
      cloud.quality.saturated_fraction =
          std::max(cloud.quality.saturated_fraction, out.cloud.quality.saturated_fraction);
    }
    const bool poor = cloud.verdict.reason != Reason::kOk;
    if (poor && shots.size() > 1) {
      cloud.verdict.detail =
          FormatText("shot %.0f of %.0f: ", static_cast<double>(k + 1), static_cast<double>(shots.size())) +
          cloud.verdict.detail;
    }
    if (k == 0 || poor) {
      out.cloud = std::move(cloud);
      if (poor || shots.size() == 1) return out;
    } else {
      out.cloud.quality = cloud.quality;
    }
    const RigView& view = k == 0 ? out.cloud.view : cloud.view;
    out.disparity_px.push_back(view.disparity_px);
    deviations.push_back(view.deviation_px);
  }
  FusedDisparities fused = FuseDisparities(out.disparity_px, deviations);
  out.cloud.view.disparity_px = fused.disparity_px;
  out.cloud.view.deviation_px = fused.deviation_px;
  out.cloud.view.points_in_world =
      PointsInWorld(fused.disparity_px, geometry.rectification, geometry.setup.world_from_left);
  out.cloud.verdict = JudgeMotion(fused.moved, out.disparity_px, geometry, bin);
  timings.cloud += laps.Lap();
  return out;
}

}  // namespace granary
