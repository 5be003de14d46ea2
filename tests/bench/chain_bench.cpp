// From the cloud to the volume against the stock chain, on the same points in one run. Each case is a process of its
// own, so that its peak of memory is its own. Usage: chain_bench [--ours] (without the stock chain, which takes
// minutes)
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <stdexcept>
#include <string>

#include "tests/bench/box_scene.h"
#include "tests/bench/chain_case.h"
#include "tests/bench/machine.h"

namespace granary {
namespace {

constexpr int kRepetitions = 9;

/// The child's half: prints what the parent shows, and a last line that it reads.
int RunCase(const std::string& chain, int threads) {
  try {
    const ChainFigures f = chain == "stock" ? RunStockChain() : RunOurChain(threads, kRepetitions);
    const auto print = [](const char* what, const ChainFigures::Step& step) {
      std::printf("    %s%-42s %10.1f %10.1f\n", what, step.name.c_str(), step.times.wall_ms, step.times.cpu_ms);
    };
    for (const auto& step : f.steps) print("", step);
    for (const auto& step : f.apart) print("alone: ", step);
    std::printf("    volume %.6f m3 under %zu triangles\n", f.volume_m3, f.triangles);
    std::printf("total %.1f %.1f %.1f %.1f\n", f.total.wall_ms, f.total.cpu_ms, f.before_mib, f.peak_mib);
  } catch (const std::exception& error) {
    std::printf("    %s\n", error.what());
    return 1;
  }
  return 0;
}

/// @return zero when the case failed
Times RunProcess(const std::string& self, const char* chain, int threads) {
  std::printf("  %-47s %10s %10s\n", (std::string(chain) + ", threads: " + std::to_string(threads)).c_str(), "wall ms",
              "CPU ms");
  std::fflush(stdout);
  const std::string command = "'" + self + "' --case " + chain + " " + std::to_string(threads) + " 2>&1";
  FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) throw std::runtime_error("chain_bench: no process could be started");
  Times total;
  double before_mib = 0, peak_mib = 0;
  char line[512];
  while (std::fgets(line, sizeof line, pipe) != nullptr) {
    if (std::sscanf(line, "total %lf %lf %lf %lf", &total.wall_ms, &total.cpu_ms, &before_mib, &peak_mib) == 4) {
      std::printf("    in all %46.1f %10.1f   %.0f MiB above the %.0f MiB of the clouds\n", total.wall_ms, total.cpu_ms,
                  peak_mib - before_mib, before_mib);
    } else {
      std::printf("%s", line);
    }
  }
  if (pclose(pipe) != 0) std::printf("    FAILED\n");
  std::fflush(stdout);
  return total;
}

}  // namespace
}  // namespace granary

int main(int argc, char** argv) {
  using namespace granary;
  if (argc == 4 && std::strcmp(argv[1], "--case") == 0) return RunCase(argv[2], std::atoi(argv[3]));
  const bool ours_only = argc == 2 && std::strcmp(argv[1], "--ours") == 0;
  if (argc > 1 && !ours_only) {
    std::fprintf(stderr, "usage: chain_bench [--ours]\n");
    return 2;
  }
  PrintMachine(argc, argv);
  std::printf("%d points a cloud, the paper's box filled 5 to 15 cm deep; ours: the fastest of %d after a warm-up\n",
              BoxScene::kWidth * BoxScene::kHeight, kRepetitions);
  const Times one = RunProcess(argv[0], "ours", 1), two = RunProcess(argv[0], "ours", 2);
  if (ours_only) return 0;
  const Times stock = RunProcess(argv[0], "stock", 1);
  if (stock.wall_ms == 0) return 1;
  std::printf("ours is %.0f times as fast on two threads (wall), %.0f times on one (CPU)\n",
              stock.wall_ms / two.wall_ms, stock.cpu_ms / one.cpu_ms);
  return 0;
}
