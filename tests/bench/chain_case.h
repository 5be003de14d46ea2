// From the cloud to the volume, once with ours and once with stock tools, on the same 1.3 million points.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace granary {

/// Milliseconds on a steady clock, and of the processor over all threads of the process.
struct Times {
  double wall_ms = 0, cpu_ms = 0;
};
/// Since the process began to count.
[[nodiscard]] Times Now();
[[nodiscard]] inline Times operator-(const Times& a, const Times& b) {
  return {a.wall_ms - b.wall_ms, a.cpu_ms - b.cpu_ms};
}

/// What one process measured, steps in their order.
struct ChainFigures {
  struct Step {
    std::string name;
    Times times;
  };
  std::vector<Step> steps;
  std::vector<Step> apart;  ///< timed alone, no part of the total
  Times total;
  double before_mib = 0, peak_mib = 0;  ///< resident: with both clouds alone, and at most
  double volume_m3 = 0;
  std::size_t triangles = 0;
};

/// A line of /proc/self/status, MiB. @throws std::runtime_error when there is none
[[nodiscard]] double Status_mib(const std::string& key);
/// Lets VmHWM start anew. @throws std::runtime_error when the kernel does not
void ResetPeak();

/// FindGrain, BuildSurface, IntegrateVolume, as Pipeline::Run has them; the fastest of `repetitions` after a warm-up,
/// for other work on the machine only adds. The floor is fitted before, as it is once a commissioning.
[[nodiscard]] ChainFigures RunOurChain(int threads, int repetitions);

/// pcl::SegmentDifferences, pcl::PassThrough along x, y and z, vtkDelaunay2D, edge limit and prisms; once.
/// Also times our triangulation of the very points that vtkDelaunay2D got.
/// @throws std::runtime_error when built without VTK
[[nodiscard]] ChainFigures RunStockChain();

}  // namespace granary
