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
#include "pipeline/relief.h"
#include "pipeline/rig_cloud.h"
#include "pipeline/rig_geometry.h"
#include "pipeline/rig_sensitivity.h"
#include "pipeline/rig_shots.h"
#include "pipeline/run_budget.h"
#include "pipeline/shots.h"
#include "pipeline/surface_samples.h"
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

constexpr std::size_t kFewestPoints = 100;  // on the grain floor; fewer are no surface

/// Keeps in `largest` the largest of the figures that are known.
void NoteLargest(std::optional<double>& largest, std::optional<double> figure) {
  if (figure) largest = std::max(largest.value_or(*figure), *figure);
}
void NoteLargest(std::optional<double>& largest_us, std::optional<std::chrono::microseconds> figure) {
  if (figure) NoteLargest(largest_us, static_cast<double>(figure->count()));
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

}  // namespace

struct Pipeline::Impl {
  Bin bin;
  PipelineOptions options;
  std::vector<RigGeometry> rigs;
  Floor floor;
  double segment_distance_m = 0;
  double floor_step_m = 0;
  std::optional<CloudNoise> empty_bin;
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

  /// The grain in the clouds of all rigs.
  struct Grain {
    std::vector<cv::Mat> masks;  ///< one a rig
    std::vector<Eigen::Vector3d> points_in_world;
    double spacing_m = 0, above_share = 0;
  };
  [[nodiscard]] Grain FindGrainOf(const std::vector<cv::Mat>& points, const std::vector<cv::Mat>& disparities) const;
  [[nodiscard]] Surface SurfaceOf(const Grain& grain) const;
  [[nodiscard]] std::optional<double> VolumeOfShot(const std::vector<RigShots>& rigs, std::size_t shot) const;
  void Describe(const Surface& surface, const VolumeResult& volume, Measurement& m) const;
  [[nodiscard]] UncertaintyBudget Budget(const PipelineRun& run, const VolumeResult& volume,
                                         const std::vector<double>& shot_volumes_m3) const;
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
    const CloudNoise noise = NoiseOfReference(*geometry.setup.reference, geometry, impl->options.stereo);
    // Of several rigs the one that saw its floor worst.
    if (!impl->empty_bin || noise.depth_step_m > impl->empty_bin->depth_step_m) impl->empty_bin = noise;
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

PipelineRun Pipeline::RunShots(const std::vector<Shot>& shots, const Inventory& inventory,
                               const Stopwatch& stopwatch) const {
  const Impl& my = *impl_;
  if (shots.empty()) throw std::invalid_argument("bin " + std::to_string(my.bin.id) + ": no shot to measure");
  for (const Shot& shot : shots) {
    if (shot.size() == my.rigs.size()) continue;
    throw std::invalid_argument("bin " + std::to_string(my.bin.id) + " has " + std::to_string(my.rigs.size()) +
                                " rigs, got " + std::to_string(shot.size()) + " pairs of frames");
  }
  PipelineRun run;
  Measurement& m = run.measurement;
  Laps laps(stopwatch);
  m.bin = my.bin.id;
  m.utc = shots.front().front().left.exposure_start;
  m.segment_distance_m = my.segment_distance_m;
  m.shots = static_cast<int>(shots.size());
  for (const Shot& shot : shots) {
    for (const auto& pair : shot) {
      m.simulated = m.simulated || pair.Simulated();
      NoteLargest(m.skew_us, pair.skew);
      NoteLargest(m.pulse_us, pair.pulse);
      NoteLargest(m.temperature_c, pair.left.temperature_c);
      NoteLargest(m.temperature_c, pair.right.temperature_c);
    }
  }
  for (const RigGeometry& geometry : my.rigs) {
    if (!geometry.setup.reference) continue;
    m.reference_id += (m.reference_id.empty() ? "" : " ") + geometry.setup.reference->id;
  }
  const auto finish = [&]() -> PipelineRun {
    m.timings_ms.total = laps.Total();
    ApplyInventory(m, inventory);
    return std::move(run);
  };

  // frames → clouds
  std::vector<RigShots> rigs;
  for (std::size_t i = 0; i < my.rigs.size(); ++i) {
    const RigGeometry& geometry = my.rigs[i];
    rigs.push_back(MakeCloudOfShots(geometry, my.bin, shots, i, my.options, laps, m.timings_ms));
    RigCloud& cloud = rigs.back().cloud;
    if (!cloud.view.left.empty()) {
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
  std::vector<cv::Mat> points, disparities;
  for (const RigView& view : run.rigs) {
    points.push_back(view.points_in_world);
    disparities.push_back(view.disparity_px);
  }
  const Impl::Grain grain = my.FindGrainOf(points, disparities);
  for (std::size_t i = 0; i < run.rigs.size(); ++i) run.rigs[i].grain_mask = grain.masks[i];
  m.points = grain.points_in_world.size();
  m.timings_ms.segment = laps.Lap();
  if (grain.above_share > kMaxAboveShare) {
    my.Fail(m, Reason::kAboveBin,
            FormatText("%.0f %% of the surface lies above the top of the bin at %.3f m", grain.above_share * 100,
                       my.bin.height_m));
    return finish();
  }
  if (m.points < kFewestPoints) {
    my.Fail(m, Reason::kCoverageLow,
            FormatText("%.0f points on the grain floor, at least %.0f", static_cast<double>(m.points), kFewestPoints));
    return finish();
  }

  // grain → surface → volume
  run.surface = my.SurfaceOf(grain);
  run.relief_area_m2 = ReliefArea_m2(run.surface);
  if (my.bin.grain.surface_offset_m) TakeReliefOff(*my.bin.grain.surface_offset_m, run.surface);
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
  std::vector<double> shot_volumes_m3;
  for (std::size_t k = 0; shots.size() > 1 && k < shots.size(); ++k) {
    if (const auto alone = my.VolumeOfShot(rigs, k)) shot_volumes_m3.push_back(*alone);
  }
  if (const double rsd = RelativeDeviation_percent(shot_volumes_m3); std::isfinite(rsd)) {
    m.repeatability_rsd_percent = rsd;
  }
  my.Describe(run.surface, volume, m);
  m.budget = my.Budget(run, volume, shot_volumes_m3);
  m.volume_u95_m3 = m.budget->Expanded_m3();
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

Pipeline::Impl::Grain Pipeline::Impl::FindGrainOf(const std::vector<cv::Mat>& points,
                                                  const std::vector<cv::Mat>& disparities) const {
  Grain out;
  for (std::size_t i = 0; i < rigs.size(); ++i) {
    GrainOptions choice;
    choice.segment_distance_m = segment_distance_m;
    choice.edge_margin_m = kWindowPixels * rigs[i].spacing_m;
    const auto& reference = rigs[i].setup.reference;
    GrainPoints grain =
        FindGrain(points[i], disparities[i], reference ? reference->points_in_world : cv::Mat(), floor, bin, choice);
    out.masks.push_back(grain.mask);
    out.points_in_world.insert(out.points_in_world.end(), grain.points_in_world.begin(), grain.points_in_world.end());
    out.spacing_m = std::max(out.spacing_m, grain.spacing_m);
    out.above_share = std::max(out.above_share, grain.above_share);
  }
  return out;
}

Surface Pipeline::Impl::SurfaceOf(const Grain& grain) const {
  return BuildSurface(grain.points_in_world, floor, bin, grain.spacing_m, options.surface.edge_threshold_m);
}

std::optional<double> Pipeline::Impl::VolumeOfShot(const std::vector<RigShots>& shots_of_rigs, std::size_t shot) const {
  std::vector<cv::Mat> points, disparities;
  for (std::size_t i = 0; i < rigs.size(); ++i) {
    disparities.push_back(shots_of_rigs[i].disparity_px[shot]);
    points.push_back(PointsInWorld(disparities.back(), rigs[i].rectification, rigs[i].setup.world_from_left));
  }
  const Grain grain = FindGrainOf(points, disparities);
  if (grain.points_in_world.size() < kFewestPoints) return std::nullopt;
  Surface surface = SurfaceOf(grain);
  if (bin.grain.surface_offset_m) TakeReliefOff(*bin.grain.surface_offset_m, surface);
  return IntegrateVolume(surface).total_m3;
}

void Pipeline::Impl::Describe(const Surface& surface, const VolumeResult& volume, Measurement& m) const {
  const double capacity_m3 = Capacity_m3(bin);
  m.volume_m3 = volume.total_m3;
  m.volume_measured_m3 = volume.measured_m3;
  m.volume_interpolated_m3 = volume.interpolated_m3;
  m.volume_percent = 100 * volume.total_m3 / capacity_m3;
  m.free_volume_m3 = capacity_m3 - volume.total_m3;
  m.edge_threshold_m = surface.edge_threshold_m;
  m.triangles = surface.triangles.size();

  // Levels: over the area for the mean; the extremes without the outermost thousandth, which is noise.
  std::vector<double> levels;
  for (std::size_t i = 0; i < surface.vertices_in_world.size(); ++i) {
    if (!surface.interpolated[i]) levels.push_back(surface.vertices_in_world[i].z());
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
}

UncertaintyBudget Pipeline::Impl::Budget(const PipelineRun& run, const VolumeResult& volume,
                                         const std::vector<double>& shot_volumes_m3) const {
  const Measurement& m = run.measurement;
  BudgetInputs in;
  in.area_m2 = volume.area_m2;
  in.interpolated_m2 = volume.area_m2 - volume.measured_area_m2;
  in.interpolated_m3 = volume.interpolated_m3;
  in.camera_height_m = rigs.front().camera_height_m;
  in.surface = NoiseOfGrain(run.rigs, rigs, options.stereo, m.distance_mean_m.value_or(in.camera_height_m));
  in.empty_bin = empty_bin;
  in.completion_deviation_m = run.surface.completion_deviation_m;
  in.relief_m2 = run.relief_area_m2;
  in.relief_deviation_m = ReliefDeviation_m(bin.grain, m.simulated);
  if (shot_volumes_m3.size() > 1) in.shots_deviation_m3 = StandardDeviation(shot_volumes_m3);
  in.shots = m.shots;

  const FloorSource source = floor.Measured() ? FloorSource::kMeasured : FloorSource::kPose;
  const RigDeviation from_rigs = DeviationOfRigs(rigs, SampleSurface(run.surface, floor, bin), source, volume.total_m3);
  in.calibration_m3 = from_rigs.calibration_m3;
  in.pose_m3 = from_rigs.pose_m3;
  return VolumeBudget(in);
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
