#include "pipeline/rig_cloud.h"

#include <algorithm>
#include <utility>

#include <opencv2/core.hpp>

#include "pipeline/points.h"
#include "pipeline/rectify.h"
#include "pipeline/stereo/match.h"
#include "pipeline/text.h"

namespace granary {

namespace {

// Less of the floor in both pictures than this is no view of the bin.
constexpr double kMinFloorInView = 0.5;
// A good pair matches nearly everywhere; below this share it is worth asking why.
constexpr double kSuspiciousShare = 0.3;

double MatchedShare(const RigGeometry& geometry, const cv::Mat& disparity_px) {
  return static_cast<double>(cv::countNonZero((disparity_px < 1e6f) & geometry.left_mask)) /
         std::max(1, cv::countNonZero(geometry.left_mask));
}

// A swapped pair matches well once the sides are exchanged back.
bool LooksSwapped(const RigGeometry& geometry, const FramePair& pair, double matched_share,
                  const PipelineOptions& options) {
  FramePair exchanged = pair;
  std::swap(exchanged.left, exchanged.right);
  std::swap(exchanged.ambient_left, exchanged.ambient_right);
  const RectifiedPair rectified = RectifyPair(exchanged, geometry.rectification);
  const StereoResult stereo =
      MatchStereo(rectified.left, rectified.right, geometry.range.range, options.stereo, rectified.usable);
  const double share = MatchedShare(geometry, stereo.disparity_px);
  return share > 0.5 && share > 3 * matched_share;
}

}  // namespace

RigCloud MakeCloud(const RigGeometry& geometry, const FramePair& pair, const PipelineOptions& options, Laps& laps,
                   StageTimings_ms& timings) {
  RigCloud out;
  if (auto fault = FrameFault(pair, geometry.rectification.size); !fault.empty()) {
    out.verdict = {Reason::kFrameInvalid, std::move(fault)};
    return out;
  }
  if (geometry.floor_in_view < kMinFloorInView) {
    out.verdict = {Reason::kFootprintOutOfView,
                   FormatText("%.0f %% of the floor lies inside both pictures, at least %.0f %%",
                              geometry.floor_in_view * 100, kMinFloorInView * 100)};
    return out;
  }
  const RectifiedPair rectified = RectifyPair(pair, geometry.rectification);
  out.view.left = rectified.left;
  out.view.right = rectified.right;
  out.quality = AssessPictures(rectified, geometry.left_mask, geometry.right_mask);
  out.verdict = JudgePictures(out.quality, options.quality);
  timings.rectify += laps.Lap();
  if (out.verdict.reason != Reason::kOk) return out;

  StereoResult stereo =
      MatchStereo(rectified.left, rectified.right, geometry.range.range, options.stereo, rectified.usable);
  out.view.disparity_px = stereo.disparity_px;
  out.view.deviation_px = stereo.deviation_px;
  timings.match += laps.Lap();
  const double share = MatchedShare(geometry, stereo.disparity_px);
  if (share < kSuspiciousShare && LooksSwapped(geometry, pair, share, options)) {
    out.verdict = {Reason::kSidesSwapped,
                   FormatText("%.0f %% of the bin's floor matches; with the sides exchanged it would be over %.0f %%",
                              share * 100, 50)};
    return out;
  }
  out.view.points_in_world = PointsInWorld(stereo.disparity_px, geometry.rectification, geometry.setup.world_from_left);
  timings.cloud += laps.Lap();
  return out;
}

}  // namespace granary
