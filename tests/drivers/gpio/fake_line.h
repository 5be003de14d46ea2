// Output lines that write down what happens to them, fail on request, and let a thread wait for an edge.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "drivers/errors.h"
#include "drivers/gpio_line.h"
#include "drivers/projector_gpio.h"

namespace granary {

/// A clock that moves when somebody sleeps, and a microsecond each time it is read. Any thread.
class FakePulseClock {
 public:
  using Time = std::chrono::steady_clock::time_point;
  [[nodiscard]] Time Now() { return Time(std::chrono::microseconds(++us_)); }
  void SleepUntil(Time time) {
    const auto until_us = std::chrono::duration_cast<std::chrono::microseconds>(time.time_since_epoch()).count();
    us_ = std::max<std::int64_t>(us_, until_us);
  }
  void Advance(std::chrono::microseconds by) { us_ += by.count(); }
  /// UTC is a day ahead.
  [[nodiscard]] UtcTime Utc() { return UtcTime(std::chrono::hours(24) + Now().time_since_epoch()); }
  [[nodiscard]] static UtcTime UtcOf(Time time) { return UtcTime(std::chrono::hours(24) + time.time_since_epoch()); }

 private:
  std::atomic<std::int64_t> us_{1'000'000'000};
};

/// What a projector's lines did, in order.
struct FakeBoard {
  struct Event {
    std::string what;  ///< "light on", "trigger off", …; "… fails" where the line threw
    FakePulseClock::Time time;
  };

  void Note(const std::string& what) {
    const std::scoped_lock lock(mutex);
    events.push_back({what, clock.Now()});
    changed.notify_all();
  }
  /// The n-th such event is there; so that no test hangs, false after ten seconds.
  [[nodiscard]] bool WaitFor(const std::string& what, int n = 1) {
    std::unique_lock lock(mutex);
    return changed.wait_for(lock, std::chrono::seconds(10), [&] { return CountLocked(what) >= n; });
  }
  [[nodiscard]] int Count(const std::string& what) {
    const std::scoped_lock lock(mutex);
    return CountLocked(what);
  }
  [[nodiscard]] std::vector<std::string> Names() {
    const std::scoped_lock lock(mutex);
    std::vector<std::string> names;
    for (const Event& event : events) names.push_back(event.what);
    return names;
  }
  [[nodiscard]] FakePulseClock::Time TimeOf(const std::string& what) {
    const std::scoped_lock lock(mutex);
    for (const Event& event : events) {
      if (event.what == what) return event.time;
    }
    return {};
  }
  [[nodiscard]] PulseClock Clock() {
    return {[this] { return clock.Now(); }, [this](FakePulseClock::Time time) { clock.SleepUntil(time); },
            [this] { return clock.Utc(); }};
  }

  FakePulseClock clock;
  std::mutex mutex;
  std::condition_variable changed;
  std::vector<Event> events;
  std::atomic<bool> light{false}, trigger{false};        ///< the levels
  std::atomic<int> fail_light_on{0}, fail_light_off{0};  ///< so many calls
  std::atomic<int> fail_trigger_on{0}, fail_trigger_off{0};
  std::atomic<bool> rises_before_failing{false};  ///< a light that fails to switch on is on all the same
  std::atomic<std::int64_t> rise_takes_us{0};     ///< real time

 private:
  [[nodiscard]] int CountLocked(const std::string& what) const {
    return static_cast<int>(
        std::count_if(events.begin(), events.end(), [&](const Event& event) { return event.what == what; }));
  }
};

class FakeLine final : public OutputLine {
 public:
  /// @param name "light" or "trigger"
  FakeLine(std::shared_ptr<FakeBoard> board, std::string name) : board_(std::move(board)), name_(std::move(name)) {}
  void Set(bool active) override {
    const bool is_light = name_ == "light";
    auto& level = is_light ? board_->light : board_->trigger;
    auto& failures = is_light ? (active ? board_->fail_light_on : board_->fail_light_off)
                              : (active ? board_->fail_trigger_on : board_->fail_trigger_off);
    const std::string what = name_ + (active ? " on" : " off");
    if (failures > 0) {
      --failures;
      if (board_->rises_before_failing) level = active;
      board_->Note(what + " fails");
      throw DeviceError(Reason::kProjectorFault, "fake", what, "fails on request");
    }
    level = active;
    board_->Note(what);
    if (active && board_->rise_takes_us > 0) {
      std::this_thread::sleep_for(std::chrono::microseconds(board_->rise_takes_us));
    }
  }

 private:
  std::shared_ptr<FakeBoard> board_;
  std::string name_;
};

}  // namespace granary
