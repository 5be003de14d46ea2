// The study of the paper on the simulator: its tables and figures from our measurements, beside what it reports. Usage:
// paper_tables [--repeats N] [--out DIR]
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "pipeline/file_bytes.h"
#include "pipeline/text.h"
#include "tests/bench/machine.h"
#include "tests/bench/paper_plots.h"
#include "tests/bench/paper_study.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

struct Column {
  const char* title;
  const char* name;  ///< in summary.csv
  const char* paper;
  const char* format;
  double PaperFigures::*figure;
};

constexpr Column kColumns[] = {
    {"mean error, 4–4.2 mm", "mean_error_4_to_4.2mm_percent", "< 0.5 %", "%+.4f %%", &PaperFigures::mean_4mm_percent},
    {"mean error, automatic", "mean_error_automatic_percent", "–", "%+.4f %%", &PaperFigures::mean_automatic_percent},
    {"worst single, > 4 mm", "worst_above_4mm_percent", "< 1.5 %", "%+.4f %%", &PaperFigures::worst_4mm_percent},
    {"worst single, automatic", "worst_automatic_percent", "–", "%+.4f %%", &PaperFigures::worst_automatic_percent},
    {"RSD, largest of 3–5 mm", "rsd_3_to_5mm_percent", "< 0.6 %", "%.4f %%", &PaperFigures::rsd_3mm_percent},
    {"RSD, automatic", "rsd_automatic_percent", "–", "%.4f %%", &PaperFigures::rsd_automatic_percent},
    {"spread over 3.5–5 mm", "spread_3.5_to_5mm_percent", "(plateau)", "%.4f %%", &PaperFigures::spread_percent},
};

std::string LongCsv(const std::vector<PaperResult>& results) {
  std::string csv = "shape,edge_threshold_m,measurement,volume_m3,error_percent\n";
  for (const PaperResult& result : results) {
    for (std::size_t i = 0; i < PaperLimits_m().size(); ++i) {
      for (std::size_t k = 0; k < result.measurements.size(); ++k) {
        const PaperMeasurement& m = result.measurements[k];
        csv += std::string(result.shape.name) +
               FormatText(",%.4f,%.0f", PaperLimits_m()[i], static_cast<double>(k + 1)) +
               FormatText(",%.9f,%.5f\n", m.steps[i].total_m3, m.Error_percent(i));
      }
    }
  }
  return csv;
}

std::string SummaryCsv(const std::vector<PaperResult>& results) {
  std::string csv = "shape,measurements";
  for (const Column& column : kColumns) csv += std::string(",") + column.name;
  for (const PaperResult& result : results) {
    csv += std::string("\n") + result.shape.name + "," + std::to_string(result.measurements.size());
    for (const Column& column : kColumns) csv += FormatText(",%.5f", result.figures.*column.figure, 0);
  }
  return csv + "\n";
}

/// A row a shape, the worst of all, and the paper's.
std::string Markdown(const std::vector<PaperResult>& results) {
  std::string text = "| shape |";
  for (const Column& column : kColumns) text += std::string(" ") + column.title + " |";
  text += "\n| --- |";
  for (std::size_t i = 0; i < std::size(kColumns); ++i) text += " --- |";
  for (const PaperResult& result : results) {
    text += std::string("\n| ") + result.shape.title + " |";
    for (const Column& column : kColumns)
      text += " " + FormatText(column.format, result.figures.*column.figure, 0) + " |";
  }
  text += "\n| **worst of the six** |";
  for (const Column& column : kColumns) {
    const auto worst = std::max_element(results.begin(), results.end(), [&](const auto& a, const auto& b) {
      return std::abs(a.figures.*column.figure) < std::abs(b.figures.*column.figure);
    });
    text += " **" + FormatText(column.format, worst->figures.*column.figure, 0) + "** |";
  }
  text += "\n| the paper |";
  for (const Column& column : kColumns) text += std::string(" ") + column.paper + " |";
  return text + "\n";
}

/// How often the true volume lay within the stated uncertainty.
void PrintUncertainty(const std::vector<PaperResult>& results) {
  std::size_t within = 0, count = 0;
  double limit_low_m = INFINITY, limit_high_m = 0, u95_percent = 0;
  for (const PaperResult& result : results) {
    for (const PaperMeasurement& m : result.measurements) {
      ++count;
      within += std::abs(m.automatic_m3 - m.truth_m3) <= m.u95_m3 ? 1 : 0;
      u95_percent += 100 * m.u95_m3 / m.truth_m3;
      limit_low_m = std::min(limit_low_m, m.automatic_limit_m);
      limit_high_m = std::max(limit_high_m, m.automatic_limit_m);
    }
  }
  std::printf(
      "\nautomatic limit %.2f to %.2f mm; stated u95 %.3f %% of the volume on average, the true volume within it in "
      "%zu of %zu\n",
      1000 * limit_low_m, 1000 * limit_high_m, u95_percent / static_cast<double>(count), within, count);
}

int Main(int argc, char** argv) {
  int repeats = 10;
  fs::path folder = "paper_tables";
  for (int i = 1; i < argc; ++i) {
    const bool value = i + 1 < argc;
    if (value && std::strcmp(argv[i], "--repeats") == 0) {
      repeats = std::atoi(argv[++i]);
    } else if (value && std::strcmp(argv[i], "--out") == 0) {
      folder = argv[++i];
    } else {
      repeats = 0;
    }
  }
  if (repeats < 2) {
    std::fprintf(stderr, "usage: paper_tables [--repeats N] [--out DIR], N at least 2\n");
    return 2;
  }
  fs::create_directories(folder);
  PrintMachine(argc, argv);
  std::printf("%zu shapes x %zu limits x %d measurements\n", PaperShapes().size(), PaperLimits_m().size(), repeats);
  std::vector<PaperResult> results;
  const auto start = std::chrono::steady_clock::now();
  for (const PaperShape& shape : PaperShapes()) {
    PaperResult& result = results.emplace_back(PaperResult{shape, MeasureShape(shape, repeats), {}});
    result.figures = Summarise(result.measurements);
    std::fprintf(stderr, "%s\n", shape.name);
  }
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
  WriteBytes(folder / "paper_tables.csv", LongCsv(results));
  WriteBytes(folder / "summary.csv", SummaryCsv(results));
  std::printf("%.0f s\n\n%s", seconds.count(), Markdown(results).c_str());
  PrintUncertainty(results);
  DrawPaperPlots(results, folder);
  std::printf("tables and plots are in %s\n", folder.c_str());
  return 0;
}

}  // namespace
}  // namespace granary

int main(int argc, char** argv) {
  try {
    return granary::Main(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "paper_tables: %s\n", error.what());
    return 1;
  }
}
