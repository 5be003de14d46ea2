// The record of one measurement: what every publisher publishes and every file stores.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "pipeline/types/frame.h"
#include "pipeline/types/reason.h"
#include "pipeline/types/uncertainty_budget.h"

namespace granary {

/// Wall-clock milliseconds of each stage.
struct StageTimings_ms {
  double capture = 0, rectify = 0, match = 0, cloud = 0, segment = 0, mesh = 0, volume = 0, total = 0;
};

/// One measurement of one bin. What was not measured is empty; an empty value is never written as 0.
///
/// `valid` is true only for figures measured in this very cycle. `simulated` marks figures from simulated frames.
struct Measurement {
  int bin = 1;
  std::uint64_t sequence = 0;
  UtcTime utc{};  ///< start of the exposure
  bool valid = false;
  bool simulated = false;
  bool reduced_accuracy = false;  ///< valid, but measured under a handicap that `detail` names
  Reason reason = Reason::kNotMeasured;
  std::string detail;  ///< one sentence for a person, empty when all is well

  std::optional<double> volume_m3;
  std::optional<double> volume_u95_m3;       ///< expanded uncertainty, k = 2
  std::optional<UncertaintyBudget> budget;   ///< what volume_u95_m3 is made of
  int shots = 1;                             ///< pairs of frames a rig that were fused
  std::optional<double> repeatability_rsd_percent;  ///< of the shots' own volumes; empty with one shot
  std::optional<double> volume_measured_m3;  ///< under triangles of measured points only
  std::optional<double> volume_interpolated_m3;
  std::optional<double> volume_percent;  ///< of the bin's capacity
  std::optional<double> free_volume_m3;
  std::optional<double> coverage_percent;                                 ///< floor area under measured triangles
  std::optional<double> level_mean_m, level_min_m, level_max_m;           ///< grain height above z = 0
  std::optional<double> distance_mean_m, distance_min_m, distance_max_m;  ///< left camera to grain

  std::optional<double> density_kg_m3;  ///< as used, before the correction
  std::optional<double> correction;
  std::optional<double> loss_kg;
  std::optional<double> mass_kg;        ///< V·k·ρ
  std::optional<double> mass_check_kg;  ///< mass + loss
  std::optional<double> book_mass_kg;
  std::optional<double> error_rate_percent;  ///< (mass_check − book) / book · 100
  std::optional<double> error_rate_u95_percent;
  std::optional<bool> abnormal;  ///< |error rate| beyond the alarm limit

  std::optional<double> edge_threshold_m;
  std::optional<double> segment_distance_m;  ///< distance to the empty bin below which a point is scene
  std::uint64_t points = 0;                  ///< grain points measured
  std::uint64_t triangles = 0;
  std::optional<double> skew_us;            ///< exposure start, left against right
  std::optional<double> pulse_us;           ///< how long the projector was lit, the longest of the shots
  std::optional<double> speckle_contrast;   ///< RMS local contrast over the local mean, left frame
  std::optional<double> saturated_percent;  ///< share of full pixels, the worse frame
  std::optional<double> epipolar_rms_px;
  std::optional<double> temperature_c;  ///< of the warmest camera
  std::string reference_id;  ///< empty when measured without a reference
  StageTimings_ms timings_ms;
  double peak_rss_mib = 0;
};

}  // namespace granary
