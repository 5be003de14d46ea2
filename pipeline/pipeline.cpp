// The page: every step of METHOD.md in its order, each a function of its own.
#include "pipeline/pipeline.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <utility>

#include <opencv2/imgproc.hpp>

#include "pipeline/floor.h"
#include "pipeline/grain.h"
#include "pipeline/inventory.h"
#include "pipeline/points.h"
#include "pipeline/quality.h"
#include "pipeline/rectify.h"
#include "pipeline/stereo/match.h"
#include "pipeline/uncertainty.h"
#include "pipeline/volume.h"

namespace granary {

namespace {

// A point nearer to the empty bin than half a pixel of disparity at the floor cannot be told from it.
constexpr double kSegmentSteps = 0.5;
// Half the matching window (census 9, refinement 11) and a pixel: nearer to a wall it sees wall and grain.
constexpr double kWindowPixels = 6;
// Less of the floor in both pictures than this is no view of the bin.
constexpr double kMinFloorInView = 0.5;
// More of the surface above the top of the bin than this is not a stray point.
constexpr double kMaxAboveShare = 0.02;

std::string Text(const char* format, double a, double b) {
  char text[200];
  std::snprintf(text, sizeof text, format, a, b);
  return text;
}

// What is known of a rig before the first picture.
struct RigPlan {
  RigSetup setup;
  Rectification rectification;
  RangeProposal range;
  RigidTransform rectified_from_world = RigidTransform::Identity();
  cv::Mat left_mask, right_mask;  // the bin's floor in the rectified pictures
  double floor_in_view = 0;       // share of the grain floor inside both pictures
  double floor_step_m = 0;        // change of depth for one pixel of disparity at the floor
  double spacing_m = 0;           // distance of neighbouring points at the floor
  double camera_height_m = 0;
};

cv::Point2d Project(const Rectification& r, const Eigen::Vector3d& point, double cx) {
  return {r.focal_px * point.x() / point.z() + cx, r.focal_px * point.y() / point.z() + r.cy_px};
}

void MaskFloor(const Bin& bin, RigPlan& plan) {
  const Rectification& r = plan.rectification;
  plan.left_mask = cv::Mat::zeros(r.size, CV_8UC1);
  plan.right_mask = cv::Mat::zeros(r.size, CV_8UC1);
  std::vector<cv::Point> left, right;
  for (const auto& corner : bin.footprint_m) {
    const Eigen::Vector3d p = plan.rectified_from_world * Eigen::Vector3d(corner.x(), corner.y(), 0);
    if (p.z() <= 0) continue;
    left.emplace_back(Project(r, p, r.left_cx_px));
    right.emplace_back(Project(r, p - Eigen::Vector3d(r.baseline_m, 0, 0), r.right_cx_px));
  }
  cv::fillPoly(plan.left_mask, std::vector{left}, 255);
  cv::fillPoly(plan.right_mask, std::vector{right}, 255);
  plan.left_mask &= r.left_inside;
  plan.right_mask &= r.right_inside;

  constexpr int kSamples = 40;
  Eigen::Vector2d low = bin.footprint_m[0], high = low;
  for (const auto& corner : bin.footprint_m) {
    low = low.cwiseMin(corner);
    high = high.cwiseMax(corner);
  }
  int all = 0, seen = 0;
  const cv::Rect picture({0, 0}, r.size);
  for (int j = 0; j < kSamples; ++j) {
    for (int i = 0; i < kSamples; ++i) {
      const Eigen::Vector2d place =
          low + (high - low).cwiseProduct(Eigen::Vector2d((i + 0.5) / kSamples, (j + 0.5) / kSamples));
      if (!IsGrainFloor(bin, place)) continue;
      ++all;
      const Eigen::Vector3d p = plan.rectified_from_world * Eigen::Vector3d(place.x(), place.y(), 0);
      if (p.z() <= 0) continue;
      const cv::Point l(Project(r, p, r.left_cx_px));
      const cv::Point q(Project(r, p - Eigen::Vector3d(r.baseline_m, 0, 0), r.right_cx_px));
      seen += picture.contains(l) && picture.contains(q) && r.left_inside.at<std::uint8_t>(l) &&
              r.right_inside.at<std::uint8_t>(q);
    }
  }
  plan.floor_in_view = all > 0 ? static_cast<double>(seen) / all : 0;
}

RigPlan PlanRig(RigSetup setup, const Bin& bin, const PipelineOptions& options) {
  RigPlan plan;
  try {
    plan.rectification = ComputeRectification(setup.calibration);
    plan.range = ProposeRange(bin, plan.rectification, setup.world_from_left, options.stereo.max_disparities);
  } catch (const std::exception& error) {
    throw std::invalid_argument("rig " + setup.name + ": " + error.what());
  }
  const RigidTransform world_from_rectified = setup.world_from_left * plan.rectification.left_from_rectified;
  plan.rectified_from_world = world_from_rectified.inverse();
  plan.camera_height_m = world_from_rectified.translation().z();
  const double floor_depth_m =
      plan.rectification.Depth_m(plan.range.range.min_px + 4.0);  // the far margin of the proposal taken off
  plan.floor_step_m = plan.rectification.DepthStep_m(floor_depth_m);
  plan.spacing_m = floor_depth_m / plan.rectification.focal_px;
  if (setup.reference) {
    const Reference& reference = *setup.reference;
    if (reference.points_in_world.size() != plan.rectification.size || reference.points_in_world.type() != CV_32FC3) {
      throw std::invalid_argument("rig " + setup.name + ": reference " + reference.id +
                                  " was taken with another picture size; take it again");
    }
    if (reference.rig_hash != HashOfRig(setup.calibration, setup.world_from_left)) {
      throw std::invalid_argument("rig " + setup.name + ": reference " + reference.id +
                                  " was taken with another calibration or pose; take it again");
    }
  }
  plan.setup = std::move(setup);
  MaskFloor(bin, plan);
  return plan;
}

std::vector<Eigen::Vector3d> ValidPoints(const cv::Mat& points) {
  std::vector<Eigen::Vector3d> out;
  for (int y = 0; y < points.rows; ++y) {
    for (int x = 0; x < points.cols; ++x) {
      const auto& p = points.at<cv::Vec3f>(y, x);
      if (std::isfinite(p[2])) out.emplace_back(p[0], p[1], p[2]);
    }
  }
  return out;
}

// Frames to points; on a poor picture the verdict says why and the rest is empty.
struct RigCloud {
  RigView view;
  Verdict verdict;
  PictureQuality quality;
};

class Laps {
 public:
  explicit Laps(const Stopwatch& stopwatch) : stopwatch_(stopwatch), start_(Now()), last_(start_) {}
  /// Milliseconds since the last lap.
  double Lap() {
    const double now = Now(), lap = now - last_;
    last_ = now;
    return lap;
  }
  [[nodiscard]] double Total() const { return Now() - start_; }

 private:
  [[nodiscard]] double Now() const { return stopwatch_ ? stopwatch_() : 0; }
  const Stopwatch& stopwatch_;
  double start_, last_;
};

RigCloud MakeCloud(const RigPlan& plan, const FramePair& pair, const PipelineOptions& options, Laps& laps,
                   StageTimings_ms& timings) {
  RigCloud out;
  if (auto fault = FrameFault(pair, plan.rectification.size); !fault.empty()) {
    out.verdict = {Reason::kFrameInvalid, std::move(fault)};
    return out;
  }
  if (plan.floor_in_view < kMinFloorInView) {
    out.verdict = {Reason::kFootprintOutOfView, Text("%.0f %% of the floor lies inside both pictures, at least %.0f %%",
                                                     plan.floor_in_view * 100, kMinFloorInView * 100)};
    return out;
  }
  const RectifiedPair rectified = RectifyPair(pair, plan.rectification);
  out.view.left = rectified.left;
  out.view.right = rectified.right;
  out.quality = AssessPictures(rectified, plan.left_mask, plan.right_mask);
  out.verdict = JudgePictures(out.quality, options.quality);
  timings.rectify += laps.Lap();
  if (out.verdict.reason != Reason::kOk) return out;

  StereoResult stereo =
      MatchStereo(rectified.left, rectified.right, plan.range.range, options.stereo, rectified.left_usable);
  out.view.disparity_px = stereo.disparity_px;
  out.view.deviation_px = stereo.deviation_px;
  timings.match += laps.Lap();

  out.view.points_in_world = PointsInWorld(stereo.disparity_px, plan.rectification, plan.setup.world_from_left);
  timings.cloud += laps.Lap();
  return out;
}

// A swapped pair matches well once the sides are exchanged back.
bool LooksSwapped(const RigPlan& plan, const FramePair& pair, double matched_share, const PipelineOptions& options) {
  FramePair exchanged = pair;
  std::swap(exchanged.left, exchanged.right);
  std::swap(exchanged.ambient_left, exchanged.ambient_right);
  const RectifiedPair rectified = RectifyPair(exchanged, plan.rectification);
  const cv::Mat disparity =
      MatchStereo(rectified.left, rectified.right, plan.range.range, options.stereo, rectified.left_usable)
          .disparity_px;
  const double share = static_cast<double>(cv::countNonZero((disparity < 1e6f) & plan.left_mask)) /
                       std::max(1, cv::countNonZero(plan.left_mask));
  return share > 0.5 && share > 3 * matched_share;
}

double MatchedShare(const RigPlan& plan, const cv::Mat& disparity) {
  return static_cast<double>(cv::countNonZero((disparity < 1e6f) & plan.left_mask)) /
         std::max(1, cv::countNonZero(plan.left_mask));
}

}  // namespace

struct Pipeline::Impl {
  Bin bin;
  PipelineOptions options;
  std::vector<RigPlan> rigs;
  Floor floor;
  double segment_distance_m = 0;
  double floor_step_m = 0;
  std::vector<std::string> notes;

  [[nodiscard]] Floor FloorFrom(const std::vector<Eigen::Vector3d>& points, double spacing_m) const {
    return Floor(points, bin, 10 * spacing_m, std::max(5 * segment_distance_m, 0.02 * bin.height_m),
                 kWindowPixels * spacing_m);
  }
  void Fail(Measurement& m, Reason reason, std::string detail) const {
    m.valid = false;
    m.reason = reason;
    m.detail = std::move(detail);
  }
  void Describe(const std::vector<GrainPoints>& grain, const Surface& surface, const VolumeResult& volume,
                Measurement& m) const;
};

Pipeline::Pipeline(Bin bin, std::vector<RigSetup> rigs, PipelineOptions options) {
  if (rigs.empty()) throw std::invalid_argument("bin " + std::to_string(bin.id) + " has no rig");
  auto impl = std::make_unique<Impl>();
  impl->bin = std::move(bin);
  impl->options = options;
  for (auto& rig : rigs) {
    impl->rigs.push_back(PlanRig(std::move(rig), impl->bin, options));
    const RigPlan& plan = impl->rigs.back();
    impl->floor_step_m = std::max(impl->floor_step_m, plan.floor_step_m);
    if (!plan.range.reaches_top) {
      impl->notes.push_back("rig " + plan.setup.name +
                            Text(": grain nearer than %.2f m to the cameras is not seen (max_disparities = %.0f)",
                                 plan.range.nearest_m, options.stereo.max_disparities));
    }
    if (!plan.setup.reference) {
      impl->notes.push_back("rig " + plan.setup.name +
                            ": no reference of the empty bin; heights are counted from z = 0 of the pose");
    }
  }
  impl->segment_distance_m = options.surface.segment_distance_m.value_or(kSegmentSteps * impl->floor_step_m);

  std::vector<Eigen::Vector3d> empty_bin;
  double spacing_m = 0;
  for (const RigPlan& plan : impl->rigs) {
    if (!plan.setup.reference) continue;
    const auto points = ValidPoints(plan.setup.reference->points_in_world);
    empty_bin.insert(empty_bin.end(), points.begin(), points.end());
    spacing_m = std::max(spacing_m, plan.spacing_m);
  }
  if (!empty_bin.empty()) {
    try {
      impl->floor = impl->FloorFrom(empty_bin, spacing_m);
    } catch (const std::exception& error) {
      throw std::invalid_argument("bin " + std::to_string(impl->bin.id) + ", reference: " + error.what());
    }
  }
  impl_ = std::move(impl);
}

Pipeline::~Pipeline() = default;
Pipeline::Pipeline(Pipeline&&) noexcept = default;

const std::vector<std::string>& Pipeline::Notes() const { return impl_->notes; }

PipelineRun Pipeline::Run(const std::vector<FramePair>& pairs, const Inventory& inventory,
                          const Stopwatch& stopwatch) const {
  if (pairs.size() != impl_->rigs.size()) {
    throw std::invalid_argument("bin " + std::to_string(impl_->bin.id) + " has " + std::to_string(impl_->rigs.size()) +
                                " rigs, got " + std::to_string(pairs.size()) + " pairs of frames");
  }
  const Impl& my = *impl_;
  PipelineRun run;
  Measurement& m = run.measurement;
  Laps laps(stopwatch);
  m.bin = my.bin.id;
  m.utc = pairs.front().left.exposure_start;
  m.segment_distance_m = my.segment_distance_m;
  for (const auto& pair : pairs) m.simulated = m.simulated || pair.Simulated();
  const auto finish = [&]() -> PipelineRun {
    m.timings_ms.total = laps.Total();
    ApplyInventory(m, inventory);
    return std::move(run);
  };

  // frames → clouds
  double matched_share = 1;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const RigPlan& plan = my.rigs[i];
    RigCloud cloud = MakeCloud(plan, pairs[i], my.options, laps, m.timings_ms);
    m.skew_us = std::max(m.skew_us.value_or(0), static_cast<double>(pairs[i].skew.count()));
    const bool assessed = !cloud.view.left.empty();
    if (assessed) {
      m.speckle_contrast = std::min(m.speckle_contrast.value_or(1e9), cloud.quality.speckle_contrast);
      m.saturated_percent = std::max(m.saturated_percent.value_or(0), 100 * cloud.quality.saturated_fraction);
    }
    run.rigs.push_back(std::move(cloud.view));
    if (cloud.verdict.reason != Reason::kOk) {
      my.Fail(m, cloud.verdict.reason, "rig " + plan.setup.name + ": " + cloud.verdict.detail);
      return finish();
    }
    const double share = MatchedShare(plan, run.rigs.back().disparity_px);
    matched_share = std::min(matched_share, share);
    if (share < 0.3 && LooksSwapped(plan, pairs[i], share, my.options)) {
      my.Fail(m, Reason::kSidesSwapped,
              "rig " + plan.setup.name +
                  Text(": %.0f %% of the picture matches, exchanged it would be more than %.0f %%", share * 100, 50));
      return finish();
    }
  }

  // clouds → grain
  std::vector<GrainPoints> grain;
  std::vector<Eigen::Vector3d> points;
  double spacing_m = 0, above_share = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const RigPlan& plan = my.rigs[i];
    GrainOptions options;
    options.segment_distance_m = my.segment_distance_m;
    options.edge_margin_m = kWindowPixels * plan.spacing_m;
    const cv::Mat empty_bin = plan.setup.reference ? plan.setup.reference->points_in_world : cv::Mat();
    grain.push_back(
        FindGrain(run.rigs[i].points_in_world, run.rigs[i].disparity_px, empty_bin, my.floor, my.bin, options));
    run.rigs[i].grain_mask = grain.back().mask;
    points.insert(points.end(), grain.back().points_in_world.begin(), grain.back().points_in_world.end());
    spacing_m = std::max(spacing_m, grain.back().spacing_m);
    above_share = std::max(above_share, grain.back().above_share);
    if (plan.setup.reference) m.reference_id += (m.reference_id.empty() ? "" : " ") + plan.setup.reference->id;
  }
  m.points = points.size();
  m.timings_ms.segment = laps.Lap();
  if (above_share > kMaxAboveShare) {
    my.Fail(m, Reason::kAboveBin,
            Text("%.0f %% of the surface lies above the top of the bin at %.3f m", above_share * 100, my.bin.height_m));
    return finish();
  }
  if (points.size() < 100) {
    my.Fail(m, Reason::kCoverageLow,
            Text("%.0f points on the grain floor, at least %.0f", static_cast<double>(points.size()), 100));
    return finish();
  }

  // grain → surface → volume
  run.surface = BuildSurface(points, my.floor, my.bin, spacing_m, my.options.surface.edge_threshold_m);
  m.timings_ms.mesh = laps.Lap();
  const VolumeResult volume = IntegrateVolume(run.surface);
  my.Describe(grain, run.surface, volume, m);
  m.timings_ms.volume = laps.Lap();
  const double coverage = *m.coverage_percent / 100;
  if (coverage < my.options.surface.min_coverage) {
    const std::string detail = Text("%.1f %% of the floor was measured, at least %.1f %%", coverage * 100,
                                    my.options.surface.min_coverage * 100);
    const Measurement poor = std::exchange(m, Measurement{});
    m.bin = poor.bin;
    m.utc = poor.utc;
    m.simulated = poor.simulated;
    m.coverage_percent = poor.coverage_percent;
    m.points = poor.points;
    m.skew_us = poor.skew_us;
    m.speckle_contrast = poor.speckle_contrast;
    m.saturated_percent = poor.saturated_percent;
    m.reference_id = poor.reference_id;
    m.timings_ms = poor.timings_ms;
    my.Fail(m, Reason::kCoverageLow, detail);
    return finish();
  }
  m.valid = true;
  m.reason = Reason::kOk;
  if (coverage < my.options.surface.reduced_coverage) {
    m.reduced_accuracy = true;
    m.detail = Text("%.1f %% of the floor was measured, full accuracy from %.1f %%", coverage * 100,
                    my.options.surface.reduced_coverage * 100);
  }
  if (!my.floor.Measured()) {
    m.reduced_accuracy = true;
    m.detail += (m.detail.empty() ? "" : "; ") +
                std::string("no reference of the empty bin: heights are counted from z = 0 of the pose");
  }
  return finish();
}

void Pipeline::Impl::Describe(const std::vector<GrainPoints>& grain, const Surface& surface, const VolumeResult& volume,
                              Measurement& m) const {
  const double floor_m2 = GrainFloor_m2(bin), capacity_m3 = Capacity_m3(bin);
  m.volume_m3 = volume.total_m3;
  m.volume_measured_m3 = volume.measured_m3;
  m.volume_interpolated_m3 = volume.interpolated_m3;
  m.volume_percent = 100 * volume.total_m3 / capacity_m3;
  m.free_volume_m3 = capacity_m3 - volume.total_m3;
  m.coverage_percent = 100 * volume.measured_area_m2 / floor_m2;
  m.edge_threshold_m = surface.edge_threshold_m;
  m.triangles = surface.triangles.size();

  // Levels: over the area for the mean; the extremes without the outermost thousandth, which is noise.
  std::vector<double> levels;
  for (const auto& rig : grain) {
    for (const auto& p : rig.points_in_world) levels.push_back(p.z());
  }
  const auto rank = [&](double share) {
    const auto at = levels.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(levels.size() - 1));
    std::nth_element(levels.begin(), at, levels.end());
    return *at;
  };
  m.level_min_m = rank(0.001);
  m.level_max_m = rank(0.999);
  double level_area = 0;
  for (const auto& t : surface.triangles) {
    const Eigen::Vector3d &a = surface.vertices_in_world[t[0]], &b = surface.vertices_in_world[t[1]],
                          &c = surface.vertices_in_world[t[2]];
    const double area =
        ((b - a).head<2>().x() * (c - a).head<2>().y() - (b - a).head<2>().y() * (c - a).head<2>().x()) / 2;
    level_area += area * (a.z() + b.z() + c.z()) / 3;
  }
  if (volume.area_m2 > 0) m.level_mean_m = level_area / volume.area_m2;
  const double camera_m = rigs.front().camera_height_m;
  if (m.level_mean_m) m.distance_mean_m = camera_m - *m.level_mean_m;
  m.distance_min_m = camera_m - *m.level_max_m;
  m.distance_max_m = camera_m - *m.level_min_m;

  const Rectification& r = rigs.front().rectification;
  UncertaintyInputs inputs;
  inputs.grain_floor_m2 = floor_m2;
  inputs.volume_m3 = volume.total_m3;
  inputs.interpolated_m3 = volume.interpolated_m3;
  inputs.surface_step_m = r.DepthStep_m(std::max(0.01, m.distance_mean_m.value_or(camera_m)));
  inputs.floor_step_m = floor_step_m;
  inputs.camera_height_m = camera_m;
  inputs.floor_measured = floor.Measured();
  m.volume_u95_m3 = VolumeUncertainty(inputs).Expanded_m3();
}

Pipeline::ReferenceRun Pipeline::TakeReference(std::size_t rig, const FramePair& pair) const {
  const Impl& my = *impl_;
  const RigPlan& plan = my.rigs.at(rig);
  ReferenceRun out;
  const Stopwatch none;
  Laps laps(none);
  StageTimings_ms timings;
  RigCloud cloud = MakeCloud(plan, pair, my.options, laps, timings);
  out.view = std::move(cloud.view);
  out.reason = cloud.verdict.reason;
  out.detail = std::move(cloud.verdict.detail);
  if (out.reason != Reason::kOk) return out;
  const double share = MatchedShare(plan, out.view.disparity_px);
  if (share < 0.3 && LooksSwapped(plan, pair, share, my.options)) {
    out.reason = Reason::kSidesSwapped;
    out.detail = Text("%.0f %% of the picture matches, exchanged it would be more than %.0f %%", share * 100, 50);
    return out;
  }
  try {
    out.coverage_percent = 100 * my.FloorFrom(ValidPoints(out.view.points_in_world), plan.spacing_m).SeenShare();
  } catch (const std::invalid_argument& error) {
    out.reason = Reason::kCoverageLow;
    out.detail = error.what();
    return out;
  }
  if (out.coverage_percent < 100 * my.options.surface.min_coverage) {
    out.reason = Reason::kCoverageLow;
    out.detail = Text("%.1f %% of the empty floor was seen, at least %.1f %%", out.coverage_percent,
                      100 * my.options.surface.min_coverage);
    return out;
  }
  Reference reference;
  reference.points_in_world = out.view.points_in_world;
  reference.noise_m = PointNoise_m(out.view.disparity_px, out.view.deviation_px, plan.rectification);
  reference.hash = HashOfPoints(reference.points_in_world);
  reference.rig_hash = HashOfRig(plan.setup.calibration, plan.setup.world_from_left);
  reference.utc = pair.left.exposure_start;
  reference.simulated = pair.Simulated();
  reference.id = "bin" + std::to_string(my.bin.id) + "-" + plan.setup.name + "-" + reference.hash.substr(0, 8);
  out.reference = std::move(reference);
  return out;
}

}  // namespace granary
