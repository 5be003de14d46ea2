// The projector on a GPIO line, with a guard that no other thread can hold up.
#pragma once

#include <chrono>
#include <functional>
#include <memory>

#include "drivers/gpio_line.h"
#include "drivers/options.h"
#include "drivers/projector.h"

namespace granary {

/// Used by one thread. A guard thread of its own switches the light off when a pulse lasts longer than max_on, whatever
/// the pulse's thread does; the next Pulse then throws. docs/laser-safety.md says what a guard in software cannot do.
class ProjectorGpio final : public Projector {
 public:
  /// Requests the lines. @throws DeviceError
  explicit ProjectorGpio(const ProjectorOptions& options);
  /// The same over lines that are there already (tests). @param trigger null: one line drives projector and cameras
  ProjectorGpio(const ProjectorOptions& options, std::unique_ptr<OutputLine> light,
                std::unique_ptr<OutputLine> trigger);
  ~ProjectorGpio() override;

  /// @throws DeviceError: kProjectorGuard when the guard had to switch off or the duty limit forbids the pulse,
  ///   kProjectorFault when the line cannot be set; std::invalid_argument when `width` exceeds max_on
  LitInterval Pulse(std::chrono::microseconds width, const std::function<void()>& lit = {}) override;
  bool TriggerDark() override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace granary
