// The table of the threshold study, and the forms in which people and programs read it.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "pipeline/edge_sweep.h"
#include "pipeline/types/frame.h"

namespace granary {

/// `from`, `from + step`, … up to `to`, metres.
/// @throws UsageError when the range is none, the step not larger than 0, or more than 1000 thresholds come out
[[nodiscard]] std::vector<double> SweepThresholds(double from_m, double to_m, double step_m);

/// One threshold over all repeats.
struct SweepRow {
  double edge_threshold_m = 0;
  std::vector<double> volumes_m3;  ///< one a repeat, in their order
  double volume_mean_m3 = 0;
  std::optional<double> rsd_percent;    ///< relative standard deviation; from two repeats on
  std::optional<double> error_percent;  ///< of the mean, against the true volume
  double coverage_percent = 0;          ///< mean floor area under triangles of measured points
};

/// One repeat: a pair of frames a rig, measured with the automatic limit and swept.
struct SweepRepeat {
  std::vector<EdgeSweepStep> steps;  ///< one a threshold
  double automatic_threshold_m = 0;
  double automatic_volume_m3 = 0;
};

struct SweepTable {
  int bin = 1;
  std::string bin_name;
  UtcTime utc{};  ///< of the first repeat
  bool simulated = false;
  std::optional<double> true_volume_m3;
  std::vector<SweepRow> rows;
  std::optional<Plateau> plateau;    ///< of the mean volumes
  double automatic_threshold_m = 0;  ///< mean over the repeats
  double automatic_volume_m3 = 0;

  [[nodiscard]] std::size_t Repeats() const { return rows.empty() ? 0 : rows.front().volumes_m3.size(); }
};

/// Rows, plateau and automatic figures from the repeats; what describes the bin is left to the caller.
/// @param repeats at least one, all over the same thresholds
/// @param true_volume_m3 larger than 0
/// @throws std::invalid_argument when the repeats are none or differ in their thresholds
[[nodiscard]] SweepTable MakeSweepTable(const std::vector<SweepRepeat>& repeats, double grain_floor_m2,
                                        std::optional<double> true_volume_m3);

/// "stable from 3.1 to 5.5 mm: 0.01902 m³, spread 0.030 %", or why there is no plateau.
[[nodiscard]] std::string PlateauSentence(const SweepTable& table);
/// The table for people, with both sentences under it; the last line without its newline.
[[nodiscard]] std::string SweepText(const SweepTable& table);
/// One row a threshold, a header whose names carry the units; unknown cells are empty.
[[nodiscard]] std::string SweepCsv(const SweepTable& table);
/// What is unknown is null.
[[nodiscard]] nlohmann::ordered_json SweepJson(const SweepTable& table);

}  // namespace granary
