// The picture of the threshold study.
#pragma once

#include <string>

#include "daemon/ctl/sweep_table.h"

namespace granary {

/// For DrawPlot. Above the volume against the threshold, or its error where the true volume is known: every repeat a
/// dot, their mean a line with bars of one standard deviation, the plateau shaded. Below the relative standard
/// deviation, or with one repeat the coverage.
/// @param table with at least one row
[[nodiscard]] std::string SweepPlotScript(const SweepTable& table);

}  // namespace granary
