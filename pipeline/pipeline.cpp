// The page: every step of METHOD.md in its order, each a function of its own.
#include "pipeline/pipeline.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "pipeline/floor.h"
#include "pipeline/grain.h"
#include "pipeline/inventory.h"
#include "pipeline/laps.h"
#include "pipeline/points.h"
#include "pipeline/rectify.h"
#include "pipeline/rig_cloud.h"
#include "pipeline/rig_geometry.h"
#include "pipeline/text.h"
#include "pipeline/uncertainty.h"
#include "pipeline/volume.h"

namespace granary {

namespace {

// A point nearer to the empty bin than half a pixel of disparity at the floor cannot be told from it.
constexpr double kSegmentSteps = 0.5;
// Half the matching window (census 9, refinement 11) and a pixel: nearer to a wall it sees wall and grain.
constexpr double kWindowPixels = 6;
// More of the surface above the top of the bin than this is not a stray point.
constexpr double kMaxAboveShare = 0.02;

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

}  // namespace

struct Pipeline::Impl {
  Bin bin;
  PipelineOptions options;
  std::vector<RigGeometry> rigs;
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
    impl->rigs.push_back(DescribeRig(std::move(rig), impl->bin, options));
    const RigGeometry& geometry = impl->rigs.back();
    impl->floor_step_m = std::max(impl->floor_step_m, geometry.floor_step_m);
    if (!geometry.range.reaches_top) {
      impl->notes.push_back("rig " + geometry.setup.name +
                            FormatText(": grain nearer than %.2f m to the cameras is not seen (max_disparities = %.0f)",
                                       geometry.range.nearest_m, options.stereo.max_disparities));
    }
    if (!geometry.setup.reference) {
      impl->notes.push_back("rig " + geometry.setup.name +
                            ": no reference of the empty bin; heights are counted from z = 0 of the pose");
    }
  }
  impl->segment_distance_m = options.surface.segment_distance_m.value_or(kSegmentSteps * impl->floor_step_m);

  std::vector<Eigen::Vector3d> empty_bin;
  double spacing_m = 0;
  for (const RigGeometry& geometry : impl->rigs) {
    if (!geometry.setup.reference) continue;
    const auto points = ValidPoints(geometry.setup.reference->points_in_world);
    empty_bin.insert(empty_bin.end(), points.begin(), points.end());
    spacing_m = std::max(spacing_m, geometry.spacing_m);
  }
  if (spacing_m > 0) {  // a reference was given; one without a single point is refused as well
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
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const RigGeometry& geometry = my.rigs[i];
    RigCloud cloud = MakeCloud(geometry, pairs[i], my.options, laps, m.timings_ms);
    m.skew_us = std::max(m.skew_us.value_or(0), static_cast<double>(pairs[i].skew.count()));
    const bool assessed = !cloud.view.left.empty();
    if (assessed) {
      m.speckle_contrast = std::min(m.speckle_contrast.value_or(1e9), cloud.quality.speckle_contrast);
      m.saturated_percent = std::max(m.saturated_percent.value_or(0), 100 * cloud.quality.saturated_fraction);
    }
    run.rigs.push_back(std::move(cloud.view));
    if (cloud.verdict.reason != Reason::kOk) {
      my.Fail(m, cloud.verdict.reason, "rig " + geometry.setup.name + ": " + cloud.verdict.detail);
      return finish();
    }
  }

  // clouds → grain
  std::vector<GrainPoints> grain;
  std::vector<Eigen::Vector3d> points;
  double spacing_m = 0, above_share = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const RigGeometry& geometry = my.rigs[i];
    GrainOptions options;
    options.segment_distance_m = my.segment_distance_m;
    options.edge_margin_m = kWindowPixels * geometry.spacing_m;
    const cv::Mat empty_bin = geometry.setup.reference ? geometry.setup.reference->points_in_world : cv::Mat();
    grain.push_back(
        FindGrain(run.rigs[i].points_in_world, run.rigs[i].disparity_px, empty_bin, my.floor, my.bin, options));
    run.rigs[i].grain_mask = grain.back().mask;
    points.insert(points.end(), grain.back().points_in_world.begin(), grain.back().points_in_world.end());
    spacing_m = std::max(spacing_m, grain.back().spacing_m);
    above_share = std::max(above_share, grain.back().above_share);
    if (geometry.setup.reference) m.reference_id += (m.reference_id.empty() ? "" : " ") + geometry.setup.reference->id;
  }
  m.points = points.size();
  m.timings_ms.segment = laps.Lap();
  if (above_share > kMaxAboveShare) {
    my.Fail(m, Reason::kAboveBin,
            FormatText("%.0f %% of the surface lies above the top of the bin at %.3f m", above_share * 100,
                       my.bin.height_m));
    return finish();
  }
  if (points.size() < 100) {
    my.Fail(m, Reason::kCoverageLow,
            FormatText("%.0f points on the grain floor, at least %.0f", static_cast<double>(points.size()), 100));
    return finish();
  }

  // grain → surface → volume
  run.surface = BuildSurface(points, my.floor, my.bin, spacing_m, my.options.surface.edge_threshold_m);
  m.timings_ms.mesh = laps.Lap();
  const VolumeResult volume = IntegrateVolume(run.surface);
  const double coverage = volume.measured_area_m2 / GrainFloor_m2(my.bin);
  m.coverage_percent = 100 * coverage;
  if (coverage < my.options.surface.min_coverage) {
    my.Fail(m, Reason::kCoverageLow,
            FormatText("%.1f %% of the floor was measured, at least %.1f %%", coverage * 100,
                       my.options.surface.min_coverage * 100));
    return finish();
  }
  my.Describe(grain, run.surface, volume, m);
  m.timings_ms.volume = laps.Lap();
  m.valid = true;
  m.reason = Reason::kOk;
  if (coverage < my.options.surface.reduced_coverage) {
    m.reduced_accuracy = true;
    m.detail = FormatText("%.1f %% of the floor was measured, full accuracy from %.1f %%", coverage * 100,
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
  m.level_mean_m = volume.level_mean_m;
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
  const RigGeometry& geometry = my.rigs.at(rig);
  ReferenceRun out;
  const Stopwatch none;
  Laps laps(none);
  StageTimings_ms timings;
  RigCloud cloud = MakeCloud(geometry, pair, my.options, laps, timings);
  out.view = std::move(cloud.view);
  out.reason = cloud.verdict.reason;
  out.detail = std::move(cloud.verdict.detail);
  if (out.reason != Reason::kOk) return out;
  try {
    out.coverage_percent = 100 * my.FloorFrom(ValidPoints(out.view.points_in_world), geometry.spacing_m).SeenShare();
  } catch (const std::invalid_argument& error) {
    out.reason = Reason::kCoverageLow;
    out.detail = error.what();
    return out;
  }
  if (out.coverage_percent < 100 * my.options.surface.min_coverage) {
    out.reason = Reason::kCoverageLow;
    out.detail = FormatText("%.1f %% of the empty floor was seen, at least %.1f %%", out.coverage_percent,
                            100 * my.options.surface.min_coverage);
    return out;
  }
  Reference reference;
  reference.points_in_world = out.view.points_in_world;
  reference.noise_m = PointNoise_m(out.view.disparity_px, out.view.deviation_px, geometry.rectification);
  reference.hash = HashOfPoints(reference.points_in_world);
  reference.rig_hash = HashOfRig(geometry.setup.calibration, geometry.setup.world_from_left);
  reference.utc = pair.left.exposure_start;
  reference.simulated = pair.Simulated();
  reference.id = "bin" + std::to_string(my.bin.id) + "-" + geometry.setup.name + "-" + reference.hash.substr(0, 8);
  out.reference = std::move(reference);
  return out;
}

}  // namespace granary
