// What a process holds: descriptors, threads and memory, as the kernel counts them.
#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <ostream>
#include <string>

namespace granary {

struct Footprint {
  long descriptors = 0, threads = 0, rss_kib = 0;
};

inline Footprint FootprintNow() {
  Footprint now;
  now.descriptors = std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {});
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind("Threads:", 0) == 0) now.threads = std::stol(line.substr(8));
    if (line.rfind("VmRSS:", 0) == 0) now.rss_kib = std::stol(line.substr(6));
  }
  return now;
}

inline std::ostream& operator<<(std::ostream& out, const Footprint& f) {
  return out << f.descriptors << " descriptors, " << f.threads << " threads, " << f.rss_kib << " KiB";
}

}  // namespace granary
