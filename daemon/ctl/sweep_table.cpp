// From the repeats to rows: means, scatter and errors once, then the same rows as text, CSV and JSON.
#include "daemon/ctl/sweep_table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "daemon/ctl/command.h"
#include "daemon/record_json.h"
#include "pipeline/shots.h"
#include "pipeline/text.h"

namespace granary {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kMostThresholds = 1000;

double Mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

std::optional<double> Rsd_percent(const std::vector<double>& values, double mean) {
  if (values.size() < 2 || mean == 0) return std::nullopt;
  return 100 * StandardDeviation(values) / std::abs(mean);
}

/// Decimals that tell all thresholds apart, millimetres.
int DecimalsOf(const std::vector<SweepRow>& rows) {
  int decimals = 1;
  const auto exact = [&](const SweepRow& row) {
    const double scaled = row.edge_threshold_m * 1000 * std::pow(10, decimals);
    return std::abs(scaled - std::round(scaled)) < 1e-6 * scaled;
  };
  while (decimals < 6 && !std::all_of(rows.begin(), rows.end(), exact)) ++decimals;
  return decimals;
}

std::string Fixed(double value, int decimals) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  return text;
}

/// `cell` on the right of a column 12 wide.
std::string Column(const std::string& cell) { return std::string(cell.size() < 12 ? 12 - cell.size() : 1, ' ') + cell; }

std::string CsvCell(const std::optional<double>& value) { return value ? FormatText("%.10g", *value, 0) : ""; }

}  // namespace

std::vector<double> SweepThresholds(double from_m, double to_m, double step_m) {
  if (!(from_m > 0) || !std::isfinite(from_m)) throw UsageError("--from: a length larger than 0 is wanted, in metres");
  if (!(to_m >= from_m) || !std::isfinite(to_m))
    throw UsageError("--to: a length not below --from is wanted, in metres");
  if (!(step_m > 0) || !std::isfinite(step_m)) throw UsageError("--step: a length larger than 0 is wanted, in metres");
  // A millionth of a step more, so that the rounding of decimal fractions does not lose the last threshold.
  const double count = std::floor((to_m - from_m) / step_m + 1e-6) + 1;
  if (count > kMostThresholds) {
    throw UsageError(FormatText("--step: %.0f thresholds come out, at most %.0f are allowed", count, kMostThresholds));
  }
  std::vector<double> thresholds_m;
  for (int i = 0; i < static_cast<int>(count); ++i) {
    // To a picometre: 0.0031 and not 0.0030999999999999995.
    thresholds_m.push_back(std::round((from_m + i * step_m) * 1e12) / 1e12);
  }
  return thresholds_m;
}

SweepTable MakeSweepTable(const std::vector<SweepRepeat>& repeats, double grain_floor_m2,
                          std::optional<double> true_volume_m3) {
  if (repeats.empty()) throw std::invalid_argument("sweep table: no repeat");
  SweepTable table;
  table.true_volume_m3 = true_volume_m3;
  const auto& first = repeats.front().steps;
  std::vector<double> thresholds_m, means_m3;
  for (std::size_t i = 0; i < first.size(); ++i) {
    SweepRow row;
    row.edge_threshold_m = first[i].edge_threshold_m;
    std::vector<double> coverages;
    for (const SweepRepeat& repeat : repeats) {
      if (repeat.steps.size() != first.size() || repeat.steps[i].edge_threshold_m != row.edge_threshold_m) {
        throw std::invalid_argument("sweep table: the repeats differ in their thresholds");
      }
      row.volumes_m3.push_back(repeat.steps[i].total_m3);
      coverages.push_back(100 * repeat.steps[i].measured_area_m2 / grain_floor_m2);
    }
    row.volume_mean_m3 = Mean(row.volumes_m3);
    row.coverage_percent = Mean(coverages);
    row.rsd_percent = Rsd_percent(row.volumes_m3, row.volume_mean_m3);
    if (true_volume_m3) row.error_percent = 100 * (row.volume_mean_m3 / *true_volume_m3 - 1);
    thresholds_m.push_back(row.edge_threshold_m);
    means_m3.push_back(row.volume_mean_m3);
    table.rows.push_back(std::move(row));
  }
  table.plateau = FindPlateau(thresholds_m, means_m3);
  std::vector<double> automatic_m, automatic_m3;
  for (const SweepRepeat& repeat : repeats) {
    automatic_m.push_back(repeat.automatic_threshold_m);
    automatic_m3.push_back(repeat.automatic_volume_m3);
  }
  table.automatic_threshold_m = Mean(automatic_m);
  table.automatic_volume_m3 = Mean(automatic_m3);
  return table;
}

std::string PlateauSentence(const SweepTable& table) {
  if (!table.plateau) {
    if (table.rows.size() < 3) return "no plateau: at least 3 thresholds are needed to tell";
    return FormatText("no plateau: no 3 thresholds in a row agree within %.1f %%", kPlateauSpreadPercent, 0);
  }
  const int decimals = DecimalsOf(table.rows);
  return "stable from " + Fixed(table.plateau->from_m * 1000, decimals) + " to " +
         Fixed(table.plateau->to_m * 1000, decimals) +
         " mm: " + FormatText("%.6g m³, spread %.3f %%", table.plateau->volume_m3, table.plateau->spread_percent);
}

std::string SweepText(const SweepTable& table) {
  const std::size_t repeats = table.Repeats();
  std::string text = "bin " + std::to_string(table.bin) + (table.bin_name.empty() ? "" : " (" + table.bin_name + ")") +
                     ", " + UtcText(table.utc) + ", " + std::to_string(repeats) +
                     (repeats == 1 ? " measurement" : " measurements") + (table.simulated ? " (simulated)" : "") + "\n";
  const bool error = table.true_volume_m3.has_value(), rsd = repeats >= 2;
  const auto line = [&](const std::string& threshold, const std::string& volume, const std::string& error_cell,
                        const std::string& rsd_cell, const std::string& coverage) {
    text += Column(threshold) + Column(volume) + (error ? Column(error_cell) : "") + (rsd ? Column(rsd_cell) : "") +
            Column(coverage) + "\n";
  };
  line("threshold", "volume", "error", "RSD", "coverage");
  line("mm", "m3", "%", "%", "%");
  const int decimals = DecimalsOf(table.rows);
  for (const SweepRow& row : table.rows) {
    line(Fixed(row.edge_threshold_m * 1000, decimals), FormatText("%#.6g", row.volume_mean_m3, 0),
         row.error_percent ? FormatText("%+.3f", *row.error_percent, 0) : "",
         row.rsd_percent ? Fixed(*row.rsd_percent, 4) : "", Fixed(row.coverage_percent, 2));
  }
  return text + PlateauSentence(table) + "\n" +
         FormatText("the automatic rule takes %.2f mm: %.6g m³", table.automatic_threshold_m * 1000,
                    table.automatic_volume_m3);
}

std::string SweepCsv(const SweepTable& table) {
  std::string text = "edge_threshold_m,volume_mean_m3,rsd_percent,error_percent,coverage_percent";
  for (std::size_t i = 1; i <= table.Repeats(); ++i) text += ",volume_" + std::to_string(i) + "_m3";
  text += "\n";
  for (const SweepRow& row : table.rows) {
    text += CsvCell(row.edge_threshold_m) + "," + CsvCell(row.volume_mean_m3) + "," + CsvCell(row.rsd_percent) + "," +
            CsvCell(row.error_percent) + "," + CsvCell(row.coverage_percent);
    for (const double volume : row.volumes_m3) text += "," + CsvCell(volume);
    text += "\n";
  }
  return text;
}

Json SweepJson(const SweepTable& table) {
  Json thresholds = Json::array();
  for (const SweepRow& row : table.rows) {
    thresholds.push_back({{"edge_threshold_m", row.edge_threshold_m},
                          {"volume_mean_m3", row.volume_mean_m3},
                          {"volumes_m3", row.volumes_m3},
                          {"rsd_percent", OrNull(row.rsd_percent)},
                          {"error_percent", OrNull(row.error_percent)},
                          {"coverage_percent", row.coverage_percent}});
  }
  Json plateau = nullptr;
  if (table.plateau) {
    plateau = {{"from_m", table.plateau->from_m},
               {"to_m", table.plateau->to_m},
               {"volume_m3", table.plateau->volume_m3},
               {"spread_percent", table.plateau->spread_percent}};
  }
  return {{"bin", table.bin},
          {"utc", UtcText(table.utc)},
          {"repeats", table.Repeats()},
          {"thresholds", thresholds},
          {"plateau", plateau},
          {"automatic", {{"edge_threshold_m", table.automatic_threshold_m}, {"volume_m3", table.automatic_volume_m3}}},
          {"simulated", table.simulated}};
}

}  // namespace granary
