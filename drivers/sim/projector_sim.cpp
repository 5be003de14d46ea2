// Obeys the limit of the real one, so that a configuration that would be refused there is refused here.
#include "drivers/sim/projector_sim.h"

#include <stdexcept>
#include <string>
#include <utility>

namespace granary {

ProjectorSim::ProjectorSim(std::shared_ptr<SimBench> bench, const ProjectorOptions& options)
    : bench_(std::move(bench)), max_on_(options.max_on) {}

LitInterval ProjectorSim::Pulse(std::chrono::microseconds width, const std::function<void()>& lit) {
  if (width <= std::chrono::microseconds::zero() || width > max_on_) {
    throw std::invalid_argument("projector: a pulse of " + std::to_string(width.count()) +
                                " us, allowed is more than 0 and up to max_on_ms, " + std::to_string(max_on_.count()) +
                                " us");
  }
  const UtcTime from = std::chrono::system_clock::now();
  bench_->Pulse();
  if (lit) lit();
  return {from, std::chrono::system_clock::now() + width};
}

}  // namespace granary
