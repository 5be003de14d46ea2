// One matcher on one pair in a process of its own.
#pragma once

#include <filesystem>
#include <string>

namespace granary {

struct StereoCase {
  std::string matcher;  ///< ours-kept, ours-fresh, ours-refined, hh, 3way or bm
  std::string folder;   ///< where RenderBenchPair left the pictures
  int width = 0, height = 0, disparities = 0, threads = 1;
};

/// Renders the pair of that size and leaves it in `folder` as left.raw and right.raw, 8-bit.
void RenderBenchPair(const std::filesystem::path& folder, int width, int height, int disparities);

/// The child's main: `--case MATCHER FOLDER WIDTH HEIGHT DISPARITIES THREADS REPETITIONS`. Prints "time WALL_ms CPU_ms"
/// for each repetition after a warm-up, timed by Google Benchmark, and "memory BEFORE_mb PEAK_mb", both resident: with
/// the pictures and the libraries alone, and at most while matching. Anything else it prints says why it failed.
/// @return the exit status
[[nodiscard]] int RunStereoCase(int argc, char** argv);

}  // namespace granary
