// The paper's Figures 17–20, drawn from our own measurements.
#pragma once

#include <filesystem>
#include <vector>

#include "tests/bench/paper_study.h"

namespace granary {

/// One shape with all its measurements.
struct PaperResult {
  PaperShape shape;
  std::vector<PaperMeasurement> measurements;
  PaperFigures figures;
};

/// Writes paper-volume.png (Figure 17), paper-error.png (18, from 3.5 mm on), paper-mean-error.png (19) and
/// paper-rsd.png (20).
/// @throws std::runtime_error as DrawPlot
void DrawPaperPlots(const std::vector<PaperResult>& results, const std::filesystem::path& folder);

}  // namespace granary
