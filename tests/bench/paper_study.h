// The paper's study on the simulator: six shapes, many edge limits, several measurements of each (METHOD §8).
#pragma once

#include <string>
#include <vector>

#include "drivers/options.h"
#include "pipeline/edge_sweep.h"

namespace granary {

struct PaperShape {
  SimShape shape;
  const char* name;   ///< as in files, e.g. "tilted_left"
  const char* title;  ///< as in plots
};

/// The six of the paper, in its order.
[[nodiscard]] const std::vector<PaperShape>& PaperShapes();
/// Its 31 edge limits, 2.5 … 5.5 mm, metres.
[[nodiscard]] const std::vector<double>& PaperLimits_m();

/// One measurement: the volume with the automatic limit, and at every limit of the paper.
struct PaperMeasurement {
  double truth_m3 = 0;
  double automatic_m3 = 0, automatic_limit_m = 0, u95_m3 = 0;
  std::vector<EdgeSweepStep> steps;

  [[nodiscard]] double Error_percent(std::size_t limit) const { return 100 * (steps[limit].total_m3 / truth_m3 - 1); }
  [[nodiscard]] double AutomaticError_percent() const { return 100 * (automatic_m3 / truth_m3 - 1); }
};

/// Measures one shape `repeats` times, each with a texture and noise of its own, against one reference of the empty
/// bin. Two at a time; the results do not depend on that.
/// @throws std::runtime_error when a measurement is invalid, with its reason
[[nodiscard]] std::vector<PaperMeasurement> MeasureShape(const PaperShape& shape, int repeats);

/// Figures of one shape; percent, and percentages signed where they are errors.
struct PaperFigures {
  std::vector<double> mean_percent, rsd_percent;  ///< one a limit: error of the mean volume, scatter
  double mean_4mm_percent = 0;                    ///< the largest mean error in size of the limits 4.0, 4.1 and 4.2 mm
  double mean_automatic_percent = 0;
  double worst_4mm_percent = 0;  ///< largest single error in size, limits above 4 mm
  double worst_automatic_percent = 0;
  double rsd_3mm_percent = 0;  ///< largest of the limits 3 … 5 mm
  double rsd_automatic_percent = 0;
  double spread_percent = 0;  ///< peak to peak of the mean volume over the limits 3.5 … 5 mm
};

[[nodiscard]] PaperFigures Summarise(const std::vector<PaperMeasurement>& measurements);

}  // namespace granary
