// A light that no thread can leave lit: its line, a guard thread and the account of its lit time.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "drivers/errors.h"
#include "drivers/gpio_line.h"
#include "drivers/lit_ledger.h"

namespace granary {

/// Dark until `before_rise`, surely lit from `after_rise` to `before_fall`, dark again from `after_fall`.
struct LitTimes {
  std::chrono::steady_clock::time_point before_rise, after_rise, before_fall, after_fall;
};

/// How long a light may be lit.
struct LightLimits {
  std::chrono::milliseconds max_on{50};  ///< at a time
  double max_duty_percent = 10;          ///< of any ten seconds
};

/// Used by one thread. The guard is another, which waits on a kernel timer set before the line rises; it switches off
/// and tries again until that works, also where the user's own switching off failed.
class GuardedLight {
 public:
  using Clock = std::chrono::steady_clock;

  /// @param device names the line in errors
  /// @param now    stamps what happens, called by both threads; the guard's timer runs on the kernel's clock
  /// @throws DeviceError
  GuardedLight(std::unique_ptr<OutputLine> line, std::string device, LightLimits limits,
               std::shared_ptr<LitLedger> ledger, std::function<Clock::time_point()> now);
  /// Dark, the guard joined; a line that cannot be switched off is logged.
  ~GuardedLight();
  GuardedLight(const GuardedLight&) = delete;
  GuardedLight& operator=(const GuardedLight&) = delete;

  /// Lights for `width` at least, if the duty limit leaves room for that; dark when it throws, or the guard is at it.
  /// @return when it was surely lit
  /// @throws DeviceError: kProjectorGuard where the duty limit forbids it, kProjectorFault for the line
  Clock::time_point SwitchOn(std::chrono::microseconds width);
  /// Lit for max_on: the guard has switched off, or is about to.
  [[nodiscard]] bool WasCut() const noexcept;
  /// Dark when it returns; a line that fails is left to the guard, and told by TakeFault.
  LitTimes SwitchOff() noexcept;
  /// What the line answered to switching off, the guard's tries included; told once.
  [[nodiscard]] std::optional<DeviceError> TakeFault();

 private:
  static constexpr std::int64_t kDark = 0, kCut = -1;

  /// A file descriptor of its own.
  class Descriptor {
   public:
    explicit Descriptor(int fd) : fd_(fd) {}
    ~Descriptor();
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;
    [[nodiscard]] int get() const { return fd_; }

   private:
    int fd_;
  };

  void RefuseIfStillLit();
  void RefuseOverDuty(std::chrono::microseconds width) const;
  void SetTimer(std::int64_t expiry_ns) const;
  [[nodiscard]] bool TurnOff() noexcept;
  void EndPulse() noexcept;
  void Guard() noexcept;
  [[nodiscard]] bool CutIfDue() noexcept;

  std::unique_ptr<OutputLine> line_;
  std::string device_;
  LightLimits limits_;
  std::shared_ptr<LitLedger> ledger_;
  std::function<Clock::time_point()> now_;
  Descriptor timer_, stop_;
  /// kDark, kCut, or the moment in nanoseconds of the kernel's clock at which the guard has to cut: it is another for
  /// every pulse, so a guard that wakes late cannot take the next pulse for the one it was woken for.
  std::atomic<std::int64_t> state_{kDark};
  std::mutex mutex_;  ///< one thread at a time sets the line; guards all below
  bool fallen_ = true;
  LitTimes times_{};
  std::string refusal_;               ///< the line's last answer while it cannot be switched off
  std::optional<DeviceError> fault_;  ///< that has not been told
  std::thread guard_;
};

}  // namespace granary
