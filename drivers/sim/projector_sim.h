// The simulated projector.
#pragma once

#include <chrono>
#include <memory>

#include "drivers/options.h"
#include "drivers/projector.h"
#include "drivers/sim/bench.h"

namespace granary {

class ProjectorSim final : public Projector {
 public:
  ProjectorSim(std::shared_ptr<SimBench> bench, const ProjectorOptions& options);
  /// Returns at once: simulated light takes no time, and is said to last `width`.
  LitInterval Pulse(std::chrono::microseconds width, const std::function<void()>& lit = {}) override;

 private:
  std::shared_ptr<SimBench> bench_;
  std::chrono::microseconds max_on_;
};

}  // namespace granary
