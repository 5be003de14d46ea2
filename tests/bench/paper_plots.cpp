// Two pages of six panels, a shape each, and two panels with a line a shape. Ranges are alike in all panels of a page,
// so that shapes can be compared.
#include "tests/bench/paper_plots.h"

#include <algorithm>
#include <cstddef>
#include <functional>
#include <iterator>
#include <string>

#include "daemon/ctl/gnuplot.h"
#include "pipeline/text.h"

namespace granary {
namespace {

// Okabe and Ito's colours, told apart by colour-blind readers too; lines differ in their marks besides.
constexpr const char* kColours[] = {"#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9"};

constexpr const char* kStyle = R"(set grid lc rgb '#d8d8d8' lw 0.7
set border 3 lc rgb '#606060'
set tics nomirror
set xrange [2.5:5.5]
set offsets 0, 0, graph 0.08, graph 0.08
)";

/// A block of rows: the limit in millimetres, then a column for each of `columns`.
std::string Block(const std::string& name, std::size_t columns,
                  const std::function<double(std::size_t limit, std::size_t column)>& value) {
  std::string text = "$" + name + " << EOD\n";
  for (std::size_t i = 0; i < PaperLimits_m().size(); ++i) {
    text += FormatText("%.1f", PaperLimits_m()[i] * 1000, 0);
    for (std::size_t k = 0; k < columns; ++k) text += FormatText(" %.7g", value(i, k), 0);
    text += "\n";
  }
  return text + "EOD\n";
}

/// Six panels, every measurement a thin line, the true value a dark one.
/// @param from_m limits from here on; the range of values is that of these limits, the same in all panels
std::string Panels(const std::vector<PaperResult>& results, double from_m, const std::string& label, double truth,
                   const std::function<double(const PaperMeasurement&, std::size_t limit)>& value) {
  double low = truth, high = truth;
  for (const PaperResult& result : results) {
    for (const PaperMeasurement& m : result.measurements) {
      for (std::size_t i = 0; i < PaperLimits_m().size(); ++i) {
        if (PaperLimits_m()[i] < from_m - 1e-6) continue;
        low = std::min(low, value(m, i));
        high = std::max(high, value(m, i));
      }
    }
  }
  const double margin = 0.08 * (high - low) + 1e-6;
  std::string script = kStyle + FormatText("set xrange [%.1f:%.1f]\n", 1000 * from_m, 1000 * PaperLimits_m().back()) +
                       FormatText("set yrange [%.7g:%.7g]\n", low - margin, high + margin) +
                       "set multiplot layout 2,3 margins 0.10,0.985,0.11,0.93 spacing 0.04,0.14\nunset key\n";
  for (std::size_t s = 0; s < results.size(); ++s) {
    const auto& measurements = results[s].measurements;
    script += Block("d", measurements.size(), [&](std::size_t i, std::size_t k) { return value(measurements[k], i); });
    script += "set title " + GnuplotQuoted(results[s].shape.title) + " offset 0,-0.6\n";
    script += "set ylabel " + GnuplotQuoted(s % 3 == 0 ? label : "") + "\n";
    script += std::string("set format y ") + (s % 3 == 0 ? "'%g'" : "''") + "\n";
    script += std::string("set xlabel ") + (s >= 3 ? "'longest edge [mm]'" : "''") + "\n";
    script += "plot for [k=2:" + std::to_string(measurements.size() + 1) + "] $d using 1:k with lines lw 1 lc rgb '" +
              kColours[0] + "', " + FormatText("%.7g", truth, 0) + " with lines lw 1.5 lc rgb '#333333'\n";
  }
  return script + "unset multiplot\n";
}

/// "plot …": a line a shape from the block $d.
std::string Lines(const std::vector<PaperResult>& results) {
  std::string plot = "plot ";
  for (std::size_t s = 0; s < results.size(); ++s) {
    plot += std::string(s == 0 ? "" : ", ") + "$d using 1:" + std::to_string(s + 2) +
            " with linespoints lw 1.5 ps 0.7 pt " + std::to_string(4 + 2 * s) + " lc rgb '" +
            kColours[s % std::size(kColours)] + "' title " + GnuplotQuoted(results[s].shape.title);
  }
  return plot + "\n";
}

/// The mean errors over all limits, and those on the plateau enlarged beside them.
std::string MeanErrors(const std::vector<PaperResult>& results) {
  return kStyle +
         Block("d", results.size(), [&](std::size_t i, std::size_t s) { return results[s].figures.mean_percent[i]; }) +
         "set xlabel 'longest edge [mm]'\nset ylabel 'mean error [%]'\n"
         "set multiplot layout 1,2 margins 0.09,0.985,0.14,0.91 spacing 0.11,0\n"
         "set key bottom right Left reverse samplen 2 opaque box lc rgb '#d8d8d8'\nset title 'all limits'\n" +
         Lines(results) + "set xrange [4:5.5]\nunset key\nset title 'from 4 mm, enlarged'\n" + Lines(results) +
         "unset multiplot\n";
}

std::string Scatter(const std::vector<PaperResult>& results) {
  return kStyle +
         Block("d", results.size(), [&](std::size_t i, std::size_t s) { return results[s].figures.rsd_percent[i]; }) +
         "unset offsets\nset logscale y\nset format y '%g'\nset xlabel 'longest edge [mm]'\n"
         "set ylabel 'relative standard deviation [%]'\n"
         "set key top right Left reverse samplen 2 opaque box lc rgb '#d8d8d8'\n" +
         Lines(results);
}

}  // namespace

void DrawPaperPlots(const std::vector<PaperResult>& results, const std::filesystem::path& folder) {
  const PlotSize page{880, 480}, panel{880, 380};
  const double truth_l = 1000 * results.front().measurements.front().truth_m3;
  DrawPlot(Panels(results, PaperLimits_m().front(), "volume [litres]", truth_l,
                  [](const PaperMeasurement& m, std::size_t i) { return 1000 * m.steps[i].total_m3; }),
           folder / "paper-volume.png", page);
  DrawPlot(Panels(results, 0.0035, "error [%]", 0,
                  [](const PaperMeasurement& m, std::size_t i) { return m.Error_percent(i); }),
           folder / "paper-error.png", page);
  DrawPlot(MeanErrors(results), folder / "paper-mean-error.png", panel);
  DrawPlot(Scatter(results), folder / "paper-rsd.png", panel);
}

}  // namespace granary
