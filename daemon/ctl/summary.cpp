// The verdict first, then the figures that are known, then how they came about.
#include "daemon/ctl/summary.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>

#include "daemon/record_json.h"

namespace granary {
namespace {

std::string Number(double value, int decimals) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  return text;
}

/// " ± 0.0002", or nothing.
std::string PlusMinus(const std::optional<double>& u95, int decimals) {
  return u95 ? " ± " + Number(*u95, decimals) : "";
}

/// Decimals that show the uncertainty with two digits; `otherwise` without one.
int DecimalsFor(const std::optional<double>& u95, int otherwise) {
  if (!u95 || !(*u95 > 0)) return otherwise;
  return std::max(0, 1 - static_cast<int>(std::floor(std::log10(*u95))));
}

void Line(std::string& text, const char* label, const std::string& value) {
  char start[32];
  std::snprintf(start, sizeof start, "\n  %-12s", label);
  text += start + value;
}

std::string VolumeText(const Measurement& m) {
  const int decimals = DecimalsFor(m.volume_u95_m3, 6);
  std::string text = Number(*m.volume_m3, decimals) + PlusMinus(m.volume_u95_m3, decimals) + " m³";
  if (m.volume_percent) text += ", " + Number(*m.volume_percent, 2) + " % of the bin";
  if (m.volume_interpolated_m3) text += "; " + Number(*m.volume_interpolated_m3, decimals) + " m³ of it completed";
  return text;
}

std::string MassText(const Measurement& m) {
  std::string text = Number(*m.mass_kg, 3) + " kg";
  if (m.density_kg_m3) text += " at " + Number(*m.density_kg_m3, 1) + " kg/m³";
  if (m.mass_check_kg && m.loss_kg.value_or(0) != 0) text += "; " + Number(*m.mass_check_kg, 3) + " kg with the loss";
  if (m.book_mass_kg) text += "; book " + Number(*m.book_mass_kg, 3) + " kg";
  return text;
}

std::string ErrorRateText(const Measurement& m) {
  std::string text = Number(*m.error_rate_percent, 2) + PlusMinus(m.error_rate_u95_percent, 2) + " % against the book";
  if (m.abnormal) text += *m.abnormal ? ": ABNORMAL" : ": normal";
  return text;
}

}  // namespace

std::string BudgetTable(const Measurement& m) {
  const UncertaintyBudget& budget = m.budget.value();
  std::string text = "uncertainty, k = 2:          m³        % of volume  error rate, points";
  const auto line = [&](const char* term, double value_m3) {
    char words[120];
    std::snprintf(words, sizeof words, "\n  %-22s %10.3g", term, 2 * value_m3);
    text += words;
    if (m.volume_m3 && *m.volume_m3 > 0) {
      std::snprintf(words, sizeof words, "   %12.3f", 200 * value_m3 / *m.volume_m3);
      text += words;
      if (m.mass_kg && m.book_mass_kg) {
        std::snprintf(words, sizeof words, "   %16.3f", 200 * value_m3 / *m.volume_m3 * *m.mass_kg / *m.book_mass_kg);
        text += words;
      }
    }
  };
  line("matching", budget.matching_m3);
  line("reference", budget.reference_m3);
  line("calibration", budget.calibration_m3);
  line("pose", budget.pose_m3);
  line("completion", budget.completion_m3);
  line("relief", budget.relief_m3);
  if (m.shots > 1) line("repeat", budget.repeat_m3);
  line("volume, combined", budget.Combined_m3());
  if (m.error_rate_u95_percent)
    text += "\n  error rate, with the density: " + Number(*m.error_rate_u95_percent, 3) + " points";
  return text;
}

std::string Summary(const Measurement& m, const Bin& bin) {
  std::string text =
      "bin " + std::to_string(m.bin) + (bin.name.empty() ? "" : " (" + bin.name + ")") + ", " + UtcText(m.utc) + ": ";
  if (!bin.grain.name.empty()) text.insert(text.size() - 2, ", " + bin.grain.name);
  text += m.valid ? (m.reduced_accuracy ? "valid, of reduced accuracy" : "valid")
                  : "INVALID: " + std::string(InfoOf(m.reason).name);
  if (m.simulated) text += " (simulated)";
  if (!m.detail.empty()) Line(text, "detail", m.detail);
  if (!m.valid && !InfoOf(m.reason).remedy.empty()) Line(text, "remedy", std::string(InfoOf(m.reason).remedy));
  if (m.volume_m3) Line(text, "volume", VolumeText(m));
  if (m.level_mean_m && m.level_min_m && m.level_max_m) {
    Line(text, "level",
         Number(*m.level_mean_m, 4) + " m mean, " + Number(*m.level_min_m, 4) + " to " + Number(*m.level_max_m, 4) +
             " m");
  }
  if (m.mass_kg) Line(text, "quantity", MassText(m));
  if (m.error_rate_percent) Line(text, "error rate", ErrorRateText(m));
  if (m.repeatability_rsd_percent) {
    Line(text, "shots",
         std::to_string(m.shots) + ", RSD of their volumes " + Number(*m.repeatability_rsd_percent, 4) + " %");
  }
  if (m.coverage_percent) Line(text, "coverage", Number(*m.coverage_percent, 1) + " % of the floor");
  if (m.triangles > 0) {
    Line(text, "surface",
         std::to_string(m.points) + " points, " + std::to_string(m.triangles) + " triangles" +
             (m.edge_threshold_m ? ", edges up to " + Number(*m.edge_threshold_m * 1000, 2) + " mm" : ""));
  }
  Line(text, "reference", m.reference_id.empty() ? "none" : m.reference_id);
  Line(text, "time",
       Number(m.timings_ms.total, 0) + " ms (capture " + Number(m.timings_ms.capture, 0) + ", match " +
           Number(m.timings_ms.match, 0) + ", mesh " + Number(m.timings_ms.mesh, 0) + "), peak " +
           Number(m.peak_rss_mib, 0) + " MiB");
  return text;
}

}  // namespace granary
