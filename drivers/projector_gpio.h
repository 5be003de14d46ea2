// The projector on a GPIO line, with a guard that no other thread can hold up.
#pragma once

#include <chrono>
#include <functional>
#include <memory>

#include "drivers/gpio_line.h"
#include "drivers/options.h"
#include "drivers/projector.h"
#include "pipeline/types/frame.h"

namespace granary {

/// The time as a pulse sees it; tests bring their own. The guard keeps to the kernel's clock whatever this says.
struct PulseClock {
  std::function<std::chrono::steady_clock::time_point()> now;  ///< any thread
  std::function<void(std::chrono::steady_clock::time_point)> sleep_until;
  std::function<UtcTime()> utc;
};

/// CLOCK_MONOTONIC and CLOCK_REALTIME.
[[nodiscard]] PulseClock SystemPulseClock();

/// Used by one thread. A guard thread of its own switches the light off when a pulse lasts longer than max_on, whatever
/// the pulse's thread does. docs/laser-safety.md says what a guard in software cannot do.
class ProjectorGpio final : public Projector {
 public:
  /// Requests the lines. @throws DeviceError
  explicit ProjectorGpio(const ProjectorOptions& options);
  /// The same over lines that are there already (tests). @param trigger null: one line drives projector and cameras
  ProjectorGpio(const ProjectorOptions& options, std::unique_ptr<OutputLine> light, std::unique_ptr<OutputLine> trigger,
                PulseClock clock = SystemPulseClock());
  ~ProjectorGpio() override;

  /// When the guard had to switch off before `lit` was through, or a line failed, this pulse throws; the next may work
  /// again. A fault that had to give way to what `lit` threw is thrown by the next pulse, without lighting. A guard
  /// that ends the last wait of a pulse as long as max_on is no fault.
  /// @throws DeviceError: kProjectorGuard when the guard had to switch off or the duty limit forbids the pulse,
  ///   kProjectorFault when a line cannot be set; std::invalid_argument when `width` is 0 or exceeds max_on
  LitInterval Pulse(std::chrono::microseconds width, const std::function<void()>& lit = {}) override;
  bool TriggerDark() override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace granary
