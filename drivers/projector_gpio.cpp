// A pulse is a straight run between two calls of the light; whatever happens in between, both lines are off at its end.
#include "drivers/projector_gpio.h"

#include <cerrno>
#include <ctime>
#include <exception>
#include <optional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

#include "drivers/errors.h"
#include "drivers/guarded_light.h"
#include "drivers/lit_ledger.h"

namespace granary {
namespace {

using std::chrono::duration_cast;
using std::chrono::nanoseconds;
using std::chrono::steady_clock;

/// Long enough for the slow optocouplers of camera inputs.
constexpr std::chrono::milliseconds kDarkTrigger{1};

/// std::this_thread would sleep for a span; a span measured before being held up ends late.
void SleepUntil(steady_clock::time_point time) {
  const auto since_boot = duration_cast<nanoseconds>(time.time_since_epoch());
  const auto whole = duration_cast<std::chrono::seconds>(since_boot);
  timespec until{};
  until.tv_sec = static_cast<time_t>(whole.count());
  until.tv_nsec = static_cast<long>((since_boot - whole).count());
  int error = 0;
  while ((error = ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr)) == EINTR) {
  }
  if (error != 0) throw std::system_error(error, std::generic_category(), "clock_nanosleep");
}

std::string LineName(const ProjectorOptions& options) {
  return options.chip + " line " + (options.line_name.empty() ? std::to_string(options.line) : options.line_name);
}

std::unique_ptr<OutputLine> OpenLight(const ProjectorOptions& options) {
  return OpenOutputLine({options.chip, options.line, options.line_name, options.active_low, "granaryd"});
}

/// The trigger is active high: active_low tells of the projector.
std::unique_ptr<OutputLine> OpenTrigger(const ProjectorOptions& options) {
  if (!options.HasTriggerLine()) return nullptr;
  return OpenOutputLine({options.chip, options.trigger_line, options.trigger_line_name, false, "granaryd trigger"});
}

}  // namespace

PulseClock SystemPulseClock() {
  return {[] { return steady_clock::now(); }, SleepUntil, [] { return UtcTime(std::chrono::system_clock::now()); }};
}

struct ProjectorGpio::Impl {
  Impl(const ProjectorOptions& settings, std::unique_ptr<OutputLine> light_line,
       std::unique_ptr<OutputLine> trigger_line, std::shared_ptr<LitLedger> ledger, PulseClock pulse_clock)
      : options(settings),
        device("projector on " + LineName(settings)),
        clock(std::move(pulse_clock)),
        trigger(std::move(trigger_line)),
        light(std::move(light_line), device, {settings.max_on, settings.max_duty_percent}, std::move(ledger),
              clock.now) {}

  /// Keeps a fault for the end of this pulse, or the start of the next. The first one gives the reason.
  void Note(const std::optional<DeviceError>& error) {
    if (!error) return;
    fault = fault ? DeviceError(fault->reason(), fault->what(), "and then", error->what()) : *error;
  }
  void ThrowFault() {
    if (fault) throw DeviceError(*std::exchange(fault, std::nullopt));
  }
  void EndTrigger() noexcept {
    Note(light.TakeFault());
    if (!trigger) return;
    try {
      trigger->Set(false);
    } catch (const DeviceError& error) {
      Note(error);
    }
  }

  ProjectorOptions options;
  std::string device;
  PulseClock clock;
  std::optional<DeviceError> fault;
  std::unique_ptr<OutputLine> trigger;
  GuardedLight light;
};

ProjectorGpio::ProjectorGpio(const ProjectorOptions& options)
    : impl_(std::make_unique<Impl>(options, OpenLight(options), OpenTrigger(options), LedgerOfLine(LineName(options)),
                                   SystemPulseClock())) {}

ProjectorGpio::ProjectorGpio(const ProjectorOptions& options, std::unique_ptr<OutputLine> light,
                             std::unique_ptr<OutputLine> trigger, PulseClock clock)
    : impl_(std::make_unique<Impl>(options, std::move(light), std::move(trigger), std::make_shared<LitLedger>(),
                                   std::move(clock))) {}

ProjectorGpio::~ProjectorGpio() = default;

LitInterval ProjectorGpio::Pulse(std::chrono::microseconds width, const std::function<void()>& lit) {
  Impl& my = *impl_;
  if (width <= std::chrono::microseconds::zero() || width > my.options.max_on) {
    throw std::invalid_argument(my.device + ": a pulse of " + std::to_string(width.count()) +
                                " us, allowed is more than 0 and up to max_on_ms, " +
                                std::to_string(std::chrono::microseconds(my.options.max_on).count()) + " us");
  }
  my.Note(my.light.TakeFault());
  my.ThrowFault();

  const auto risen = my.light.SwitchOn(width);
  UtcTime from{};
  steady_clock::time_point from_steady{};
  std::exception_ptr thrown;
  bool cut = false;
  try {
    from = my.clock.utc();
    from_steady = my.clock.now();
    if (my.trigger || lit) my.clock.sleep_until(risen + my.options.settle);
    if (my.trigger) my.trigger->Set(true);
    if (lit) lit();
    cut = my.light.WasCut();
    if (!cut) my.clock.sleep_until(risen + width);
  } catch (...) {
    thrown = std::current_exception();
    cut = my.light.WasCut();
  }
  const LitTimes times = my.light.SwitchOff();
  if (cut) {
    my.Note(DeviceError(Reason::kProjectorGuard, my.device, "pulse",
                        "the guard switched the light off after max_on_ms, " +
                            std::to_string(my.options.max_on.count()) + " ms: the pulse was held up"));
  }
  my.EndTrigger();
  if (thrown) std::rethrow_exception(thrown);
  my.ThrowFault();
  // By the steady clock, for UTC may be set while the light is on.
  return {from, from + duration_cast<nanoseconds>(times.before_fall - from_steady)};
}

bool ProjectorGpio::TriggerDark() {
  Impl& my = *impl_;
  if (!my.trigger) return false;
  my.ThrowFault();
  try {
    my.trigger->Set(true);
    my.clock.sleep_until(my.clock.now() + kDarkTrigger);
  } catch (...) {
    my.EndTrigger();
    throw;
  }
  my.EndTrigger();
  my.ThrowFault();
  return true;
}

}  // namespace granary
