// A GPIO chip as one version of libgpiod shows it; projector_gpio_v1.cpp or projector_gpio_v2.cpp is built.
#pragma once

#include <memory>
#include <string>

#include "drivers/gpio_line.h"

namespace granary {

struct GpioLineInfo {
  std::string name;      ///< empty: it has none
  std::string consumer;  ///< who holds it; may be empty also while it is used
  bool used = false;
};

/// Errors of the library are std::system_error with the call's name.
class GpioChip {
 public:
  virtual ~GpioChip() = default;
  [[nodiscard]] virtual std::string Label() const = 0;
  [[nodiscard]] virtual unsigned LineCount() const = 0;
  /// As it is now. @param offset below LineCount()
  [[nodiscard]] virtual GpioLineInfo Info(unsigned offset) const = 0;
  /// For output, inactive from the start. The line may outlive the chip.
  /// @param device names the line in what it throws
  [[nodiscard]] virtual std::unique_ptr<OutputLine> Request(unsigned offset, const LineRequest& request,
                                                            const std::string& device) = 0;
};

[[nodiscard]] std::unique_ptr<GpioChip> OpenGpioChip(const std::string& path);

/// The call that has just failed, with errno.
[[noreturn]] void ThrowGpioError(const char* call);

/// At the end of a line: inactive, or an error in the log, for there is nobody left to throw to.
void EndLine(OutputLine& line, const std::string& device) noexcept;

}  // namespace granary
