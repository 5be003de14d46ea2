// What the Modbus server takes and gives, beside a server of libmodbus in the same run: requests a second, latency of
// good clients among hostile ones, malformed frames, and a burst of connections. Servers are processes of their own;
// what is compared takes turns.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <string>
#include <thread>
#include <vector>

#include <modbus/modbus.h>
#include <CLI/CLI.hpp>

#include "tests/bench/machine.h"
#include "tests/bench/modbus_hostile.h"
#include "tests/bench/modbus_load.h"
#include "tests/bench/modbus_malformed.h"
#include "tests/bench/modbus_rivals.h"

namespace granary::bench {
namespace {

using std::chrono::milliseconds;

int Cores() { return static_cast<int>(std::max(1u, std::thread::hardware_concurrency())); }

struct Spread {
  double median = 0, low = 0, high = 0;
};

Spread SpreadOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return {values[values.size() / 2], values.front(), values.back()};
}

double Quantile(const std::vector<double>& sorted, double share) {
  if (sorted.empty()) return 0;
  return sorted[std::min(sorted.size() - 1, static_cast<std::size_t>(share * static_cast<double>(sorted.size())))];
}

void Throughput(int connections, int outstanding, int rounds, milliseconds duration) {
  const bool pinned = Cores() >= 2;
  std::printf("\nThroughput: %d connections, FC3 of 125 registers, %d outstanding on each; %d rounds of %.1f s.\n",
              connections, outstanding, rounds, std::chrono::duration<double>(duration).count());
  std::printf("%s\n", pinned ? "Server on core 0, the client, one thread, on core 1."
                             : "One core: server and client share it.");
  const std::vector<Rival> rivals{Rival::kOurs, Rival::kLibmodbus, Rival::kFloor};
  struct Row {
    std::vector<double> rate, server_us, server_busy, client_busy;
  };
  std::vector<Row> rows(rivals.size());
  bool prompt = false;
  for (int round = 0; round < rounds; ++round) {
    for (std::size_t i = 0; i < rivals.size(); ++i) {
      const ServerProcess server(rivals[i], pinned ? 0 : -1);
      Flow flow;
      std::exception_ptr fault;
      // A thread, so that the bench itself stays free of the core.
      std::thread([&] {
        try {
          if (pinned) PinTo(1);
          prompt = GoFirst();
          flow = RunFlow(server, connections, outstanding, duration);
        } catch (...) {
          fault = std::current_exception();
        }
      }).join();
      if (fault) std::rethrow_exception(fault);
      const auto requests = static_cast<double>(flow.requests);
      rows[i].rate.push_back(requests / flow.seconds);
      rows[i].server_us.push_back(1e6 * flow.server_cpu_seconds / requests);
      rows[i].server_busy.push_back(100 * flow.server_cpu_seconds / flow.seconds);
      rows[i].client_busy.push_back(100 * flow.client_cpu_seconds / flow.seconds);
    }
  }
  std::printf("%s\n", prompt ? "All of them with real-time priority, so that nothing else takes their cores."
                             : "No real-time priority: what else runs on this machine takes part.");
  std::printf("%-10s %28s %26s %12s %12s\n", "server", "requests/s (min–max)", "server µs/request", "server busy",
              "client busy");
  for (std::size_t i = 0; i < rivals.size(); ++i) {
    const Spread rate = SpreadOf(rows[i].rate), us = SpreadOf(rows[i].server_us);
    std::printf("%-10s %10.0f (%6.0f–%6.0f) %10.2f (%5.2f–%5.2f) %10.0f %% %10.0f %%\n",
                std::string(NameOf(rivals[i])).c_str(), rate.median, rate.low, rate.high, us.median, us.low, us.high,
                SpreadOf(rows[i].server_busy).median, SpreadOf(rows[i].client_busy).median);
  }
  const auto ratio = [&](std::size_t over, std::size_t under, std::vector<double> Row::*figure) {
    std::vector<double> ratios;
    for (int r = 0; r < rounds; ++r) ratios.push_back((rows[over].*figure)[r] / (rows[under].*figure)[r]);
    return SpreadOf(ratios);
  };
  const Spread rate = ratio(0, 1, &Row::rate), cost = ratio(1, 0, &Row::server_us);
  std::printf("ours / libmodbus, requests/s: %.2f (%.2f–%.2f), of rounds\n", rate.median, rate.low, rate.high);
  std::printf("libmodbus / ours, server time a request: %.2f (%.2f–%.2f)\n", cost.median, cost.low, cost.high);
}

void HostileRow(Rival rival, const std::string& name, std::span<const HostileKind> kinds, milliseconds duration) {
  const ServerProcess server(rival, -1, Cores());
  Polls polls;
  {
    const HostileProcess hostile(kinds, server.Port());
    std::this_thread::sleep_for(milliseconds{300});
    polls = RunPollers(server.Port(), 8, milliseconds{100}, duration);
  }
  const auto& ms = polls.latencies_ms;
  std::printf("%-26s %-10s %7zu %6d %6d %9.2f %9.2f %9.2f %11.2f%s\n", name.c_str(), std::string(NameOf(rival)).c_str(),
              ms.size(), polls.failures, polls.missed, Quantile(ms, 0.5), Quantile(ms, 0.99),
              ms.empty() ? 0 : ms.back(), Quantile(polls.late_ms, 0.99),
              server.Running() ? "" : "  the server has died");
  std::fflush(stdout);
}

void Hostile(milliseconds duration) {
  std::printf(
      "\nHostile load: 8 good clients poll 125 registers at 10 Hz for %.0f s; %d threads of the server's process\n"
      "spin at normal priority beside it. Times in ms; failed: no answer in 2 s, closed, or wrong; missed: polls\n"
      "left out while one was waiting; woken late: p99 of how late the pollers themselves were woken.\n",
      std::chrono::duration<double>(duration).count(), Cores());
  std::printf("%-26s %-10s %7s %6s %6s %9s %9s %9s %11s\n", "hostile clients", "server", "polls", "failed", "missed",
              "p50", "p99", "max", "woken late");
  const auto rows = [&](const std::string& name, std::span<const HostileKind> kinds, milliseconds time) {
    for (const Rival rival : {Rival::kOurs, Rival::kLibmodbus}) HostileRow(rival, name, kinds, time);
  };
  rows("none", {}, duration / 3);
  for (const HostileKind& kind : HostileKinds()) rows(std::string(kind.name), {&kind, 1}, duration / 3);
  rows("all eight", HostileKinds(), duration);
}

bool Malformed(std::uint64_t frames) {
  const ServerProcess server(Rival::kOurs, -1);
  const int before = server.Descriptors();
  const auto start = std::chrono::steady_clock::now();
  const MalformedCount count = SendMalformed(server, frames, 1);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::this_thread::sleep_for(milliseconds{500});
  std::printf(
      "\nMalformed: %llu malformed frames in %.1f s: %llu refused with the right exception, %llu closed; %llu more\n"
      "were good requests and answered as such. Wrong replies: %llu. Server %s; descriptors %d before, %d after.\n",
      static_cast<unsigned long long>(count.frames), seconds, static_cast<unsigned long long>(count.exceptions),
      static_cast<unsigned long long>(count.closed), static_cast<unsigned long long>(count.good),
      static_cast<unsigned long long>(count.wrong_replies), server.Running() ? "alive" : "DEAD", before,
      server.Descriptors());
  return count.wrong_replies == 0 && server.Running();
}

bool Burst(int connections) {
  const ServerProcess server(Rival::kOurs, -1, 0, 32);
  const int before = server.Descriptors();
  Polls polls;
  int peak = 0;
  std::vector<double> newcomers_ms;
  int newcomers_failed = 0;
  {
    std::jthread good([&] { polls = RunPollers(server.Port(), 2, milliseconds{10}, milliseconds{3000}); });
    std::this_thread::sleep_for(milliseconds{500});
    std::vector<FileDescriptor> burst;
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < connections; ++i) burst.push_back(ConnectFrom("127.0.2.1", server.Port()));
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::printf("\nBurst: %d connections from one address within %.0f ms, held for 2 s; our server takes 32 clients.\n",
                connections, 1000 * seconds);
    for (int i = 0; i < 20; ++i) {
      peak = std::max(peak, server.Descriptors());
      // Somebody new among them, once each 100 ms.
      const Polls one = RunPollers(server.Port(), 1, milliseconds{1}, milliseconds{1});
      newcomers_failed += one.failures;
      newcomers_ms.insert(newcomers_ms.end(), one.latencies_ms.begin(), one.latencies_ms.end());
      std::this_thread::sleep_for(milliseconds{100});
    }
  }
  std::this_thread::sleep_for(milliseconds{500});
  const int after = server.Descriptors();
  std::sort(newcomers_ms.begin(), newcomers_ms.end());
  std::printf("Descriptors of the server: %d before, %d at most, %d after.\n", before, peak, after);
  std::printf("Two clients at 100 Hz meanwhile: %zu answered, %d failed, p99 %.2f ms, max %.2f ms.\n",
              polls.latencies_ms.size(), polls.failures, Quantile(polls.latencies_ms, 0.99),
              polls.latencies_ms.empty() ? 0 : polls.latencies_ms.back());
  std::printf("Newcomers meanwhile: %zu answered, %d failed, max %.2f ms.\n", newcomers_ms.size(), newcomers_failed,
              newcomers_ms.empty() ? 0 : newcomers_ms.back());
  return after == before && polls.failures == 0 && newcomers_failed == 0;
}

}  // namespace
}  // namespace granary::bench

int main(int argc, char** argv) {
  using namespace granary::bench;
  CLI::App app("The Modbus server against libmodbus', against hostile clients, and against rubbish.");
  std::string part = "all";
  int connections = 64, rounds = 7, seconds = 3, hostile_seconds = 30;
  std::uint64_t frames = 1000000;
  app.add_option("part", part)->check(CLI::IsMember({"all", "throughput", "hostile", "malformed", "burst"}));
  app.add_option("--connections", connections, "of the throughput")->check(CLI::Range(1, 120));
  app.add_option("--rounds", rounds, "of the throughput")->check(CLI::Range(1, 1000));
  app.add_option("--seconds", seconds, "of a round")->check(CLI::Range(1, 1000));
  app.add_option("--hostile-seconds", hostile_seconds, "of all hostile clients together; a third of it for each kind")
      ->check(CLI::Range(3, 3600));
  app.add_option("--frames", frames, "malformed ones");
  CLI11_PARSE(app, argc, argv);
  granary::PrintMachine(argc, argv);
  std::printf("libmodbus %s\n", LIBMODBUS_VERSION_STRING);
  const auto asked = [&](const char* name) { return part == "all" || part == name; };
  bool well = true;
  try {
    if (asked("throughput")) {
      // 16 is the most that the Modbus Messaging guide (V1.0b, §4.3.1.1) lets a server be asked for at a time.
      for (const int outstanding : {1, 16}) Throughput(connections, outstanding, rounds, std::chrono::seconds{seconds});
    }
    if (asked("hostile")) Hostile(std::chrono::seconds{hostile_seconds});
    if (asked("malformed")) well = Malformed(frames) && well;
    if (asked("burst")) well = Burst(1000) && well;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "modbus_bench: %s\n", error.what());
    return 1;
  }
  return well ? 0 : 1;
}
