// One surface a measurement serves all limits, so that 6 × 31 × 10 volumes cost 60 measurements.
#include "tests/bench/paper_study.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "tests/scene/simulated_bin.h"

namespace granary {
namespace {

constexpr double kSlack_m = 1e-6;  // limits are tenths of millimetres: which of them lie in a range

/// The larger in size, with its sign.
double Worse(double a, double b) { return std::abs(b) > std::abs(a) ? b : a; }

}  // namespace

const std::vector<PaperShape>& PaperShapes() {
  static const std::vector<PaperShape> shapes{
      {SimShape::kFlat, "flat", "flat"},
      {SimShape::kTiltedLeft, "tilted_left", "tilted left"},
      {SimShape::kTiltedRight, "tilted_right", "tilted right"},
      {SimShape::kConvex, "convex", "convex"},
      {SimShape::kConcave, "concave", "concave"},
      {SimShape::kPartial, "partial", "floor not covered"},
  };
  return shapes;
}

const std::vector<double>& PaperLimits_m() {
  static const std::vector<double> limits_m = [] {
    std::vector<double> limits;
    for (int tenth = 25; tenth <= 55; ++tenth) limits.push_back(tenth / 1e4);
    return limits;
  }();
  return limits_m;
}

std::vector<PaperMeasurement> MeasureShape(const PaperShape& shape, int repeats) {
  SimOptions options;
  options.shape = shape.shape;
  const RigWorld world = SimulatedLab();
  const Pipeline pipeline = CommissionedPipeline(world, options);
  std::vector<PaperMeasurement> measurements(static_cast<std::size_t>(repeats));
  const auto measure = [&](std::size_t i) {
    SimOptions own = options;
    own.seed = i + 1;
    SimScene scene(own, world);
    const PipelineRun run = pipeline.Run({scene.Render(own.seed)}, {});
    const Measurement& m = run.measurement;
    if (!m.valid) {
      throw std::runtime_error(std::string(shape.name) + ", measurement " + std::to_string(i + 1) + ": " +
                               std::string(InfoOf(m.reason).name) + ": " + m.detail);
    }
    measurements[i] = {scene.TruthVolume_m3(), m.volume_m3.value(), run.surface.edge_threshold_m,
                       m.volume_u95_m3.value(), SweepEdgeLimits(run.surface, PaperLimits_m())};
  };
  tbb::parallel_for(std::size_t{0}, measurements.size(), [&](std::size_t i) {
    // A thread that waits inside one measurement would else begin another, with all its memory.
    tbb::this_task_arena::isolate([&] { measure(i); });
  });
  return measurements;
}

PaperFigures Summarise(const std::vector<PaperMeasurement>& measurements) {
  PaperFigures figures;
  const double truth_m3 = measurements.front().truth_m3;
  double low = INFINITY, high = -INFINITY;
  for (std::size_t i = 0; i < PaperLimits_m().size(); ++i) {
    const double limit_m = PaperLimits_m()[i];
    const auto within = [&](double from_m, double to_m) {
      return limit_m > from_m - kSlack_m && limit_m < to_m + kSlack_m;
    };
    std::vector<double> volumes_m3;
    for (const PaperMeasurement& m : measurements) {
      volumes_m3.push_back(m.steps[i].total_m3);
      if (limit_m > 0.004 + kSlack_m) figures.worst_4mm_percent = Worse(figures.worst_4mm_percent, m.Error_percent(i));
    }
    const ErrorStatistics error = Summarise(volumes_m3, truth_m3);
    figures.mean_percent.push_back(error.mean_percent);
    figures.rsd_percent.push_back(error.rsd_percent);
    if (within(0.004, 0.0042)) figures.mean_4mm_percent = Worse(figures.mean_4mm_percent, error.mean_percent);
    if (within(0.003, 0.005)) figures.rsd_3mm_percent = std::max(figures.rsd_3mm_percent, error.rsd_percent);
    if (within(0.0035, 0.005)) {
      low = std::min(low, error.mean_percent);
      high = std::max(high, error.mean_percent);
    }
  }
  figures.spread_percent = high - low;
  std::vector<double> automatic_m3;
  for (const PaperMeasurement& m : measurements) {
    automatic_m3.push_back(m.automatic_m3);
    figures.worst_automatic_percent = Worse(figures.worst_automatic_percent, m.AutomaticError_percent());
  }
  const ErrorStatistics automatic = Summarise(automatic_m3, truth_m3);
  figures.mean_automatic_percent = automatic.mean_percent;
  figures.rsd_automatic_percent = automatic.rsd_percent;
  return figures;
}

}  // namespace granary
