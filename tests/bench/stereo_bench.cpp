// The matcher against OpenCV's and against the limit of the machine: each case runs in a process of its own, so that
// its peak of memory is its own, and the processes take turns, so that a busy machine slows all of them alike. Usage:
// stereo_bench [--quick] [--rounds N]
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <hwy/highway.h>
#include <hwy/targets.h>
#include <opencv2/core.hpp>

#include "tests/bench/machine.h"
#include "tests/bench/stereo_case.h"
#include "tests/bench/stereo_limit.h"
#include "tests/bench/stereo_pairs.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

struct Figures {
  std::vector<double> wall_ms, cpu_ms;
  double pictures_mb = 0, peak_mb = 0;
  std::string failure;
};

double Median(std::vector<double> values) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

// One process: warm-up, then `repetitions`; what it prints is read back.
void RunCase(const std::string& self, const StereoCase& what, bool keep_memory, int repetitions, Figures& figures) {
  // glibc gives large blocks back to the kernel at once and gets fresh pages for the next call unless told otherwise.
  const char* kept =
      "MALLOC_TOP_PAD_=4294967296 MALLOC_MMAP_THRESHOLD_=68719476736 MALLOC_TRIM_THRESHOLD_=68719476736 ";
  std::ostringstream command;
  command << (keep_memory ? kept : "") << "'" << self << "' --case " << what.matcher << " " << what.folder << " "
          << what.width << " " << what.height << " " << what.disparities << " " << what.threads << " " << repetitions
          << " 2>&1";
  FILE* pipe = popen(command.str().c_str(), "r");
  if (pipe == nullptr) throw std::runtime_error("stereo_bench: no process could be started");
  char line[512];
  std::string last = "the process ended without a word";
  bool complete = false;
  while (std::fgets(line, sizeof line, pipe) != nullptr) {
    double a = 0, b = 0;
    if (std::sscanf(line, "time %lf %lf", &a, &b) == 2) {
      figures.wall_ms.push_back(a);
      figures.cpu_ms.push_back(b);
    } else if (std::sscanf(line, "memory %lf %lf", &a, &b) == 2) {
      figures.pictures_mb = a;
      figures.peak_mb = std::max(figures.peak_mb, b);
      complete = true;
    } else {
      last = line;
    }
  }
  if (pclose(pipe) != 0 || !complete) figures.failure = last.substr(0, last.find('\n'));
}

void PrintInstructionSet() {
  const std::int64_t sets = hwy::SupportedTargets();
  std::printf("best instruction set: %s\n", hwy::TargetName(sets & -sets));
}

struct Size {
  int width, height, disparities, repetitions;
};

struct Entry {
  const char* title;
  const char* matcher;
  bool keep_memory;
};

constexpr Entry kEntries[] = {
    {"ours, memory kept", "ours-kept", true},   {"ours, fresh memory", "ours-fresh", false},
    {"ours, refined", "ours-refined", true},    {"OpenCV MODE_HH, memory kept", "hh", true},
    {"OpenCV MODE_HH as shipped", "hh", false}, {"OpenCV 3WAY, memory kept", "3way", true},
    {"OpenCV 3WAY as shipped", "3way", false},  {"OpenCV StereoBM, memory kept", "bm", true},
};
constexpr std::size_t kOurs = 0, kRefined = 2, kHH = 3, kShipped = 4;

double Least(const std::vector<double>& values) {
  return values.empty() ? std::nan("") : *std::min_element(values.begin(), values.end());
}

/// The median of the CPU time where there is one thread; else the least of the wall's, since other work on the machine
/// only ever adds to it.
double Time_ms(const Figures& figures, int threads) {
  return threads == 1 ? Median(figures.cpu_ms) : Least(figures.wall_ms);
}

/// CPU seconds of the whole machine, and of this process with its children.
struct Usage {
  double machine_s = 0, own_s = 0;
};

Usage ReadUsage() {
  Usage usage;
  std::ifstream stat("/proc/stat");
  std::string name;
  double user = 0, nice = 0, system = 0;
  stat >> name >> user >> nice >> system;
  usage.machine_s = (user + nice + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
  for (const int who : {RUSAGE_SELF, RUSAGE_CHILDREN}) {
    rusage used{};
    getrusage(who, &used);
    for (const timeval& time : {used.ru_utime, used.ru_stime}) {
      usage.own_s += static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
    }
  }
  return usage;
}

struct Summary {
  double ours_ms = 0, refined_ms = 0, kept_hh_ms = 0, shipped_hh_ms = 0, limit_ms = 0;
  double avx2_limit_ms = std::numeric_limits<double>::quiet_NaN();
  double peak_mb = 0;
};

Summary RunSize(const std::string& self, const std::string& folder, const Size& size, int threads, int rounds) {
  const double evaluations = static_cast<double>(size.width) * size.height * size.disparities;
  std::vector<Figures> all(std::size(kEntries));
  std::vector<LimitRate> limits;
  const Usage before = ReadUsage();
  for (int round = 0; round < rounds; ++round) {
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (!all[i].failure.empty()) continue;
      const StereoCase what{kEntries[i].matcher, folder, size.width, size.height, size.disparities, threads};
      RunCase(self, what, kEntries[i].keep_memory, size.repetitions, all[i]);
    }
    const auto now = MeasureLimit(size.disparities, threads);
    if (limits.empty() || now.front().updates_per_s > limits.front().updates_per_s) limits = now;
  }
  const double limit_ms = 8 * evaluations / limits.front().updates_per_s * 1e3;
  const double ours_ms = Time_ms(all[kOurs], threads);
  std::printf("\n%d x %d x %d, %d thread%s: medians of %d processes x %d runs after a warm-up; %s\n", size.width,
              size.height, size.disparities, threads, threads == 1 ? "" : "s", rounds, size.repetitions,
              threads == 1 ? "ratios from CPU ms" : "ratios from the least wall ms");
  std::printf("%-30s %8s %8s %8s %8s %8s %8s %9s %9s\n", "", "CPU ms", "wall ms", "least", "Meval/s", "used MB",
              "start MB", "to ours", "to limit");
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Figures& f = all[i];
    if (!f.failure.empty()) {
      std::printf("%-30s fails: %s\n", kEntries[i].title, f.failure.c_str());
      continue;
    }
    const double ms = Time_ms(f, threads);
    std::printf("%-30s %8.1f %8.1f %8.1f %8.0f %8.0f %8.0f %8.2fx %8.2fx\n", kEntries[i].title, Median(f.cpu_ms),
                Median(f.wall_ms), Least(f.wall_ms), evaluations / ms / 1e3, f.peak_mb - f.pictures_mb, f.pictures_mb,
                ms / ours_ms, ms / limit_ms);
  }
  std::printf("%-30s %8s %8s %8.1f %8.0f  ", "limit (path updates alone)", "", "", limit_ms,
              evaluations / limit_ms / 1e3);
  for (std::size_t i = 0; i < std::min<std::size_t>(limits.size(), 4); ++i) {
    std::printf(" %s %.1f G/s%s", limits[i].form.c_str(), limits[i].updates_per_s / 1e9, i < 3 ? "," : "\n");
  }
  const Usage after = ReadUsage();
  const double own_s = after.own_s - before.own_s, others_s = after.machine_s - before.machine_s - own_s;
  std::printf("  other programs took %.0f s of CPU time beside our %.0f s%s\n", std::max(0.0, others_s), own_s,
              others_s > 0.1 * own_s ? ": NOT A QUIET MACHINE, times of two threads mean little" : "");
  std::fflush(stdout);
  Summary summary{.ours_ms = ours_ms,
                  .refined_ms = Time_ms(all[kRefined], threads),
                  .kept_hh_ms = Time_ms(all[kHH], threads),
                  .shipped_hh_ms = Time_ms(all[kShipped], threads),
                  .limit_ms = limit_ms,
                  .peak_mb = all[kOurs].peak_mb - all[kOurs].pictures_mb};
  for (const LimitRate& rate : limits) {
    if (!std::isfinite(summary.avx2_limit_ms) && rate.form.starts_with("AVX2")) {
      summary.avx2_limit_ms = 8 * evaluations / rate.updates_per_s * 1e3;
    }
  }
  return summary;
}

void PrintTargets(const Size& size, const Summary& one, const Summary& two) {
  std::printf("\n%d x %d x %d against what is wanted:\n", size.width, size.height, size.disparities);
  const auto row = [](const char* what, double value, const char* unit, bool at_least, double wanted) {
    const char* verdict = !std::isfinite(value)                            ? "no figure"
                          : (at_least ? value >= wanted : value <= wanted) ? "met"
                                                                           : "missed";
    std::printf("  %-58s %8.2f %-2s  wanted %s %.4g  %s\n", what, value, unit, at_least ? ">=" : "<=", wanted, verdict);
  };
  row("MODE_HH with its memory kept / ours, 1 thread", one.kept_hh_ms / one.ours_ms, "x", true, 3.5);
  row("MODE_HH as shipped / ours, 1 thread", one.shipped_hh_ms / one.ours_ms, "x", true, 18);
  row("1 thread / 2 threads, ours (CPU of one / wall of two)", one.ours_ms / two.ours_ms, "x", true, 1.8);
  row("ours / limit, 1 thread", one.ours_ms / one.limit_ms, "x", false, 2.0);
  row("ours / limit of AVX2, 1 thread", one.ours_ms / one.avx2_limit_ms, "x", false, 2.0);
  row("refinement alone / ours without it, 1 thread", one.refined_ms / one.ours_ms - 1, "x", false, 1.0);
  const bool large = size.width > 2000;
  row("peak memory of ours", large ? two.peak_mb : one.peak_mb, "MB", false, large ? 1200 : 400);
}

int Main(int argc, char** argv) {
  bool quick = false;
  int rounds = 3;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--quick") == 0) {
      quick = true;
    } else if (std::strcmp(argv[i], "--rounds") == 0 && i + 1 < argc) {
      rounds = std::max(1, std::atoi(argv[++i]));
    } else {
      std::fprintf(stderr, "usage: stereo_bench [--quick] [--rounds N]\n");
      return 2;
    }
  }
  PrintMachine(argc, argv);
  PrintInstructionSet();
  const std::string self = fs::read_symlink("/proc/self/exe").string();
  const fs::path folder = fs::temp_directory_path() / ("stereo_bench." + std::to_string(getpid()));
  fs::create_directory(folder);
  std::vector<Size> sizes = {{640, 480, 64, 4}, {1280, 1024, 128, 4}, {2448, 2048, 256, 2}};
  if (quick) sizes.resize(1);
  for (const Size& size : sizes) {
    RenderBenchPair(folder, size.width, size.height, size.disparities);
    const Summary one = RunSize(self, folder.string(), size, 1, rounds),
                  two = RunSize(self, folder.string(), size, 2, rounds);
    PrintTargets(size, one, two);
    std::fflush(stdout);
  }
  fs::remove_all(folder);
  return 0;
}

}  // namespace
}  // namespace granary

int main(int argc, char** argv) {
  if (argc > 1 && std::strcmp(argv[1], "--case") == 0) return granary::RunStereoCase(argc, argv);
  return granary::Main(argc, argv);
}
