#include "daemon/memory.h"

#include <sys/resource.h>

namespace granary {

double PeakRss_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

}  // namespace granary
