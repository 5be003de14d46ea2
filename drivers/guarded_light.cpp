// The guard holds no lock while it waits and needs none to notice that time is up. The mutex is held for single calls
// of the line only, since libgpiod wants one thread at a time; a driver that hangs in the kernel hangs the guard too.
#include "drivers/guarded_light.h"

#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <spdlog/spdlog.h>
#include <sys/eventfd.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <ctime>
#include <exception>
#include <system_error>
#include <utility>

namespace granary {
namespace {

constexpr int kRetry_ms = 5;
constexpr int kLastTries = 3;
constexpr int kGuardPriority = 10;  // threads that serve interrupts have 50
constexpr std::int64_t kSecond_ns = 1'000'000'000;

std::int64_t KernelNow_ns() {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string Milliseconds(std::chrono::nanoseconds time) {
  std::array<char, 32> text{};
  (void)std::snprintf(text.data(), text.size(), "%.1f ms", static_cast<double>(time.count()) * 1e-6);
  return text.data();
}

/// Names this thread and gives it real-time priority, which the unit allows (LimitRTPRIO=). Without it the guard waits
/// its turn: with six busy threads a core, one cut in a hundred came more than 17 ms late, with it 2 ms.
void RiseAboveLoad() {
  static std::atomic<bool> told{false};
  (void)::pthread_setname_np(::pthread_self(), "projector-guard");
  sched_param parameters{};
  parameters.sched_priority = kGuardPriority;
  const int error = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters);
  if (error == 0 || told.exchange(true)) return;
  spdlog::warn("the projector's guard runs without real-time priority and may be late under load: {}",
               std::generic_category().message(error));
}

}  // namespace

GuardedLight::Descriptor::~Descriptor() {
  if (fd_ >= 0) ::close(fd_);
}

GuardedLight::GuardedLight(std::unique_ptr<OutputLine> line, std::string device, LightLimits limits,
                           std::shared_ptr<LitLedger> ledger, std::function<Clock::time_point()> now)
    : line_(std::move(line)),
      device_(std::move(device)),
      limits_(limits),
      ledger_(std::move(ledger)),
      now_(std::move(now)),
      timer_(::timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC)),
      stop_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
  const int error = errno;
  if (timer_.get() < 0 || stop_.get() < 0) {
    throw DeviceError(Reason::kProjectorFault, device_, "start the guard", std::generic_category().message(error));
  }
  try {
    guard_ = std::thread([this] { Guard(); });
  } catch (const std::system_error& failure) {
    throw DeviceError(Reason::kProjectorFault, device_, "start the guard", failure.what());
  }
}

GuardedLight::~GuardedLight() {
  const auto is_dark = [this] {
    const std::scoped_lock lock(mutex_);
    if (state_.load() == kDark) return true;
    if (!fallen_ && !TurnOff()) return false;
    EndPulse();
    return true;
  };
  bool dark = is_dark();
  for (int tries = 1; !dark && tries < kLastTries; ++tries) {
    std::this_thread::sleep_for(std::chrono::milliseconds(kRetry_ms));
    dark = is_dark();
  }
  if (!dark) spdlog::critical("{}: given up while the light may still be on", device_);
  const std::uint64_t one = 1;
  // An eventfd that holds zero always takes one; the guard must not outlive this object.
  if (::write(stop_.get(), &one, sizeof one) != sizeof one) std::terminate();
  guard_.join();
}

GuardedLight::Clock::time_point GuardedLight::SwitchOn(std::chrono::microseconds width) {
  const std::scoped_lock lock(mutex_);
  RefuseIfStillLit();
  RefuseOverDuty(width);
  const std::int64_t cut_at_ns = KernelNow_ns() + std::chrono::nanoseconds(limits_.max_on).count();
  SetTimer(cut_at_ns);
  times_ = {};
  times_.before_rise = now_();
  fallen_ = false;
  state_.store(cut_at_ns);
  try {
    // Not if this thread was held up so long that the guard has been here already.
    if (state_.load() == cut_at_ns) line_->Set(true);
  } catch (...) {
    // The line may have risen all the same.
    if (TurnOff()) EndPulse();
    throw;
  }
  times_.after_rise = now_();
  return times_.after_rise;
}

void GuardedLight::RefuseIfStillLit() {
  if (state_.load() == kDark) return;
  if (!fallen_) {
    throw DeviceError(Reason::kProjectorFault, device_, "switch on", "it cannot be switched off: " + refusal_);
  }
  EndPulse();
}

void GuardedLight::RefuseOverDuty(std::chrono::microseconds width) const {
  using std::chrono::nanoseconds;
  const auto limit = nanoseconds(static_cast<std::int64_t>(
      limits_.max_duty_percent / 100 * static_cast<double>(nanoseconds(LitLedger::kWindow).count())));
  const std::string allowed = Milliseconds(limit) + " in any ten seconds (max_duty_percent)";
  if (width > limit) {
    throw DeviceError(Reason::kProjectorGuard, device_, "switch on",
                      "a pulse of " + Milliseconds(width) + " is never allowed: " + allowed);
  }
  const auto now = now_();
  const auto from = ledger_->AllowedFrom(now, width, limit);
  if (from == now) return;
  throw DeviceError(Reason::kProjectorGuard, device_, "switch on",
                    "lit for " + Milliseconds(ledger_->LitBetween(now + width - LitLedger::kWindow, now)) +
                        " lately, with this pulse of " + Milliseconds(width) + " more than " + allowed +
                        "; allowed again in " + Milliseconds(from - now));
}

bool GuardedLight::WasCut() const noexcept {
  const std::int64_t state = state_.load();
  return state != kDark && state <= KernelNow_ns();
}

LitTimes GuardedLight::SwitchOff() noexcept {
  const std::scoped_lock lock(mutex_);
  const bool cut_before = fallen_;
  const LitTimes cut = times_;
  // Also after the guard: that costs nothing, and the line is off whatever the guard believes.
  if (!TurnOff()) return times_;
  if (cut_before) times_ = cut;
  EndPulse();
  return times_;
}

/// Under the mutex, when the line has fallen.
void GuardedLight::EndPulse() noexcept {
  state_.store(kDark);
  refusal_.clear();
  SetTimer(0);
  ledger_->Add(times_.before_rise, times_.after_fall);
}

std::optional<DeviceError> GuardedLight::TakeFault() {
  const std::scoped_lock lock(mutex_);
  return std::exchange(fault_, std::nullopt);
}

/// Under the mutex. @return whether it worked; if not, the guard tries on
bool GuardedLight::TurnOff() noexcept {
  times_.before_fall = now_();
  try {
    line_->Set(false);
    times_.after_fall = now_();
    fallen_ = true;
    return true;
  } catch (const std::exception& error) {
    if (refusal_.empty()) spdlog::error("{}: cannot be switched off, trying on: {}", device_, error.what());
    refusal_ = error.what();
    fault_.emplace(Reason::kProjectorFault, device_, "switch off", error.what());
    fallen_ = false;
    state_.store(kCut);
    SetTimer(1);
    return false;
  }
}

void GuardedLight::SetTimer(std::int64_t expiry_ns) const {
  itimerspec spec{};
  spec.it_value.tv_sec = static_cast<time_t>(expiry_ns / kSecond_ns);
  spec.it_value.tv_nsec = static_cast<long>(expiry_ns % kSecond_ns);
  if (::timerfd_settime(timer_.get(), TFD_TIMER_ABSTIME, &spec, nullptr) != 0) {
    throw DeviceError(Reason::kProjectorFault, device_, "set the guard's timer",
                      std::generic_category().message(errno));
  }
}

void GuardedLight::Guard() noexcept {
  RiseAboveLoad();
  bool again = false;
  for (;;) {
    std::array<pollfd, 2> waits{pollfd{timer_.get(), POLLIN, 0}, pollfd{stop_.get(), POLLIN, 0}};
    const int ready = ::poll(waits.data(), waits.size(), again ? kRetry_ms : -1);
    // Without its wait the guard is worth nothing: the process ends, and starts anew in the dark.
    if (ready < 0 && errno != EINTR) std::terminate();
    if (ready > 0 && waits[1].revents != 0) return;
    std::uint64_t expired = 0;
    // Nothing to read means that a new pulse has set the timer anew; its deadline decides.
    if (ready > 0 && ::read(timer_.get(), &expired, sizeof expired) < 0 && errno != EAGAIN && errno != EINTR) {
      std::terminate();
    }
    again = !CutIfDue();
  }
}

/// @return false where the line has to be tried again
bool GuardedLight::CutIfDue() noexcept {
  std::int64_t state = state_.load();
  if (state == kDark) return true;
  if (state != kCut) {
    // Woken for a pulse before this one.
    if (KernelNow_ns() < state) return true;
    // Just ended by its own thread; where that failed, the timer has been set anew.
    if (!state_.compare_exchange_strong(state, kCut)) return true;
  }
  const std::scoped_lock lock(mutex_);
  if (state_.load() != kCut || fallen_) return true;
  return TurnOff();
}

}  // namespace granary
