// What a benchmark says of where and how it ran.
#pragma once

#include <sys/utsname.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <thread>

#include <opencv2/core/version.hpp>

namespace granary {

/// Prints command, processor, load and compiler.
inline void PrintMachine(int count, char** arguments) {
  utsname name{};
  uname(&name);
  std::string line, model = name.machine;
  for (std::ifstream cpu("/proc/cpuinfo"); std::getline(cpu, line);) {
    if (line.starts_with("model name")) model = line.substr(line.find(':') + 2);
  }
  double load = 0;
  const bool loaded = getloadavg(&load, 1) == 1;
  std::printf("command:");
  for (int i = 0; i < count; ++i) std::printf(" %s", arguments[i]);
  std::printf("\nmachine: %s, %u hardware threads, %s %s, load %.1f\n", model.c_str(),
              std::thread::hardware_concurrency(), name.sysname, name.release, loaded ? load : -1.0);
  std::printf("compiler: g++ %s, OpenCV %s\n", __VERSION__, CV_VERSION);
}

}  // namespace granary
