// The rows go into the script as data blocks, so that one text draws the picture anywhere.
#include "daemon/ctl/sweep_plot.h"

#include <algorithm>
#include <cmath>

#include "daemon/ctl/gnuplot.h"
#include "daemon/record_json.h"
#include "pipeline/text.h"

namespace granary {
namespace {

std::string Row(double x, double y) { return FormatText("%.9g %.9g", x, y); }

/// What the upper panel shows of a volume: its error in percent where the true one is known.
double Shown(const SweepTable& table, double volume_m3) {
  return table.true_volume_m3 ? 100 * (volume_m3 / *table.true_volume_m3 - 1) : volume_m3;
}

/// False with one repeat, and where all volumes are 0.
bool HasScatter(const SweepTable& table) {
  return std::all_of(table.rows.begin(), table.rows.end(), [](const SweepRow& row) { return row.rsd_percent; });
}

std::string Data(const SweepTable& table) {
  const bool scatter = HasScatter(table);
  std::string means = "$mean << EOD\n", repeats = "$repeat << EOD\n";
  for (const SweepRow& row : table.rows) {
    const double deviation = row.rsd_percent.value_or(0) / 100 * std::abs(row.volume_mean_m3);
    const double scale = table.true_volume_m3 ? 100 / *table.true_volume_m3 : 1;
    means += Row(row.edge_threshold_m * 1000, Shown(table, row.volume_mean_m3)) + " " +
             Row(deviation * scale, scatter ? *row.rsd_percent : row.coverage_percent) + "\n";
    for (const double volume : row.volumes_m3) {
      repeats += Row(row.edge_threshold_m * 1000, Shown(table, volume)) + "\n";
    }
  }
  return means + "EOD\n" + repeats + "EOD\n";
}

std::string Title(const SweepTable& table) {
  return "bin " + std::to_string(table.bin) + (table.bin_name.empty() ? "" : " (" + table.bin_name + ")") + ", " +
         UtcText(table.utc) + (table.simulated ? " (simulated)" : "");
}

}  // namespace

std::string SweepPlotScript(const SweepTable& table) {
  const bool scatter = HasScatter(table);
  const double first_mm = table.rows.front().edge_threshold_m * 1000,
               last_mm = table.rows.back().edge_threshold_m * 1000;
  std::string script = Data(table) + R"(set multiplot
set lmargin at screen 0.13
set rmargin at screen 0.97
set grid lc rgb '#d8d8d8' lw 0.7
set border 3 lc rgb '#606060'
set tics nomirror
set offsets 0, 0, graph 0.05, graph 0.05
set key bottom right Left reverse samplen 2 opaque box lc rgb '#d8d8d8'
set tmargin at screen 0.92
set bmargin at screen 0.42
set format x ''
)";
  // A single threshold makes no range.
  if (last_mm > first_mm) script += FormatText("set xrange [%.9g:%.9g]\n", first_mm, last_mm);
  std::string keys;
  if (table.plateau) {
    script += FormatText("set object 1 rectangle from first %.9g, graph 0 to first %.9g, graph 1 behind ",
                         table.plateau->from_m * 1000, table.plateau->to_m * 1000) +
              "fillcolor rgb '#e2f0d9' fillstyle solid noborder\n";
    keys += ", keyentry with boxes lc rgb '#e2f0d9' fillstyle solid title 'plateau'";
  }
  if (const double automatic_mm = table.automatic_threshold_m * 1000;
      automatic_mm >= first_mm && automatic_mm <= last_mm) {
    script +=
        FormatText("set arrow 1 from first %.9g, graph 0 to first %.9g, graph 1 nohead ", automatic_mm, automatic_mm) +
        "dashtype 2 lc rgb '#555555'\n";
    keys += ", keyentry with lines dashtype 2 lc rgb '#555555' title 'automatic limit'";
  }
  script += "set title " + GnuplotQuoted(Title(table)) + " noenhanced\n";
  script += "set ylabel " + GnuplotQuoted(table.true_volume_m3 ? "error of the volume [%]" : "volume [m³]") + "\n";
  script += "plot $repeat using 1:2 with points pt 6 ps 0.8 lc rgb '#6baed6' title 'single measurements', ";
  script += std::string("$mean using 1:2") + (scatter ? ":3 with yerrorlines" : " with linespoints") +
            " pt 7 ps 0.6 lw 1.5 lc rgb '#08519c' title 'mean" + (scatter ? ", one standard deviation" : "") + "'" +
            keys;
  script += R"(
unset title
unset arrow 1
unset key
set tmargin at screen 0.38
set bmargin at screen 0.10
set format x '%g'
set xlabel 'longest edge of a triangle [mm]'
)";
  script += std::string("set ylabel '") + (scatter ? "RSD [%]" : "coverage [%]") + "'\n";
  if (scatter) script += "set yrange [0:*]\n";
  return script + "plot $mean using 1:4 with linespoints pt 7 ps 0.6 lw 1.5 lc rgb '#a63603'\nunset multiplot\n";
}

}  // namespace granary
