// Peaks come from VmHWM, reset once the pictures are loaded: getrusage's would count what the parent held when it
// forked.
#include "tests/bench/stereo_case.h"

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <functional>
#include <memory>
#include <stdexcept>
#include <vector>

#include <benchmark/benchmark.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <opencv2/core.hpp>

#include "pipeline/large_pages.h"
#include "pipeline/stereo/match.h"
#include "tests/bench/stereo_pairs.h"

namespace granary {

namespace {

constexpr int kRefineRadius_px = 5;

double Status_mb(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with(key + ":")) return std::atof(line.c_str() + key.size() + 1) / 1024;
  }
  throw std::runtime_error("no " + key + " in /proc/self/status");
}

cv::Mat ReadRaw(const std::filesystem::path& file, int width, int height) {
  cv::Mat picture(height, width, CV_8UC1);
  std::ifstream in(file, std::ios::binary);
  if (!in.read(reinterpret_cast<char*>(picture.data), static_cast<std::streamsize>(picture.total()))) {
    throw std::runtime_error(file.string() + " cannot be read");
  }
  return picture;
}

void WriteRaw(const std::filesystem::path& file, const cv::Mat& picture) {
  std::ofstream out(file, std::ios::binary);
  if (!out.write(reinterpret_cast<const char*>(picture.data), static_cast<std::streamsize>(picture.total()))) {
    throw std::runtime_error(file.string() + " cannot be written");
  }
}

std::function<void()> Matcher(const std::string& name, const cv::Mat& left, const cv::Mat& right, int disparities) {
  const DisparityRange range{0, disparities};
  if (name.starts_with("ours")) {
    StereoOptions options;
    options.speckle_area_px = 0;
    options.refine_radius_px = name == "ours-refined" ? kRefineRadius_px : 0;
    if (name == "ours-fresh") {
      return [=] { benchmark::DoNotOptimize(MatchStereo(left, right, range, options)); };
    }
    return [=, buffers = std::make_shared<MatchBuffers>()] {
      benchmark::DoNotOptimize(MatchStereo(left, right, range, options, {}, buffers.get()));
    };
  }
  const auto kind = name == "hh"     ? OpenCVMatcher::kHH
                    : name == "3way" ? OpenCVMatcher::k3Way
                    : name == "bm"   ? OpenCVMatcher::kBlock
                                     : throw std::runtime_error("no matcher is called " + name);
  return [=, peer = OpenCVPeer(kind, range), fixed = cv::Mat()]() mutable { peer.Match(left, right, fixed); };
}

/// Prints nothing but what the parent reads.
class LineReporter : public benchmark::BenchmarkReporter {
 public:
  bool ReportContext(const Context& /*context*/) override { return true; }
  void ReportRuns(const std::vector<Run>& runs) override {
    for (const Run& run : runs) {
      if (run.run_type != Run::RT_Iteration) continue;
      std::printf("time %.4f %.4f\n", run.GetAdjustedRealTime(), run.GetAdjustedCPUTime());
    }
  }
};

void RunCase(const StereoCase& what, int repetitions) {
  if (what.matcher.starts_with("ours")) UseLargePagesForPictures();  // as our programs do
  const tbb::global_control threads(tbb::global_control::max_allowed_parallelism, what.threads);
  cv::setNumThreads(what.threads);
  const cv::Mat left = ReadRaw(what.folder + "/left.raw", what.width, what.height);
  const cv::Mat right = ReadRaw(what.folder + "/right.raw", what.width, what.height);
  const auto match = Matcher(what.matcher, left, right, what.disparities);
  std::ofstream("/proc/self/clear_refs") << "5";  // VmHWM starts anew
  const double before_mb = Status_mb("VmRSS");
  tbb::parallel_for(0, 1000, [](int) { benchmark::ClobberMemory(); });  // starts the workers
  // Warm: pages, caches and the processor's clock settle over half a second.
  const auto start = std::chrono::steady_clock::now();
  do {
    match();
  } while (std::chrono::steady_clock::now() - start < std::chrono::milliseconds(500));

  benchmark::RegisterBenchmark("match",
                               [&](benchmark::State& state) {
                                 for (auto _ : state) match();
                               })
      ->Unit(benchmark::kMillisecond)
      ->MeasureProcessCPUTime()
      ->UseRealTime()
      ->Iterations(1)
      ->Repetitions(repetitions);
  LineReporter reporter;
  benchmark::RunSpecifiedBenchmarks(&reporter);
  std::printf("memory %.1f %.1f\n", before_mb, Status_mb("VmHWM"));
}

}  // namespace

void RenderBenchPair(const std::filesystem::path& folder, int width, int height, int disparities) {
  const cv::Size size(width, height);
  const RenderedPair pair = RenderPair(size, CurvedSurface(size, disparities), {});
  WriteRaw(folder / "left.raw", pair.left);
  WriteRaw(folder / "right.raw", pair.right);
}

int RunStereoCase(int argc, char** argv) {
  if (argc != 9) {
    std::printf("usage: --case MATCHER FOLDER WIDTH HEIGHT DISPARITIES THREADS REPETITIONS\n");
    return 2;
  }
  try {
    RunCase({argv[2], argv[3], std::atoi(argv[4]), std::atoi(argv[5]), std::atoi(argv[6]), std::atoi(argv[7])},
            std::atoi(argv[8]));
  } catch (const std::exception& error) {
    std::printf("%s\n", error.what());
    return 1;
  }
  return 0;
}

}  // namespace granary
