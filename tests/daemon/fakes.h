// A clock that goes when told, devices that fail when told, publishers that remember.
#pragma once

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "daemon/clock.h"
#include "daemon/publisher.h"
#include "daemon/record_json.h"
#include "drivers/errors.h"
#include "drivers/rig.h"
#include "pipeline/types/measurement.h"

namespace granary {

/// "2026-11-22T06:00:00Z" as time.
inline UtcTime At(const std::string& text) { return RecordFromJson({{"bin", 1U}, {"utc", text}}).utc; }

/// Both clocks stand still but for Advance and Wait, which passes at once. Any thread.
class FakeClock : public Clock {
 public:
  explicit FakeClock(UtcTime now = At("2026-11-22T06:00:00Z")) : now_(now) {}
  [[nodiscard]] UtcTime Now() const override {
    const std::scoped_lock lock(mutex_);
    return now_;
  }
  [[nodiscard]] std::chrono::steady_clock::time_point Steady() const override {
    const std::scoped_lock lock(mutex_);
    return steady_;
  }
  [[nodiscard]] bool Wait(const std::stop_token& stop, std::chrono::milliseconds duration) override {
    if (stop.stop_requested()) return false;
    Advance(duration);
    return true;
  }
  void Advance(std::chrono::milliseconds duration) {
    const std::scoped_lock lock(mutex_);
    now_ += duration;
    steady_ += duration;
    waited_ += duration;
  }
  /// Moves the wall clock alone, as NTP or an administrator does.
  void SetBack(std::chrono::milliseconds duration) {
    const std::scoped_lock lock(mutex_);
    now_ -= duration;
  }
  [[nodiscard]] std::chrono::milliseconds waited() const {
    const std::scoped_lock lock(mutex_);
    return waited_;
  }

 private:
  mutable std::mutex mutex_;
  UtcTime now_;
  std::chrono::steady_clock::time_point steady_{std::chrono::hours{1}};
  std::chrono::milliseconds waited_{0};
};

/// What the fake devices of one rig do and have seen. Any thread.
struct FakeBench {
  int failing_opens = 0, failing_grabs = 0;  ///< so many of the next ones (of both cameras together) throw
  int armed = 0;
  bool failing = false;  ///< the grabs of the pair that is armed
  Reason reason = Reason::kFrameMissing;
  bool block_grab = false;  ///< until interrupted
  int opens = 0, closes = 0, pulses = 0;
  bool blocked = false, interrupted = false;
  std::mutex mutex;
  std::condition_variable changed;
};

class FakeCamera : public Camera {
 public:
  explicit FakeCamera(std::shared_ptr<FakeBench> bench) : bench_(std::move(bench)) {}
  ~FakeCamera() override { ++bench_->closes; }
  [[nodiscard]] std::string Id() const override { return "fake"; }
  void Arm() override {
    if (bench_->armed++ > 0) return;
    bench_->failing = bench_->failing_grabs > 0;
    if (bench_->failing) --bench_->failing_grabs;
  }
  [[nodiscard]] Frame Grab(std::chrono::milliseconds) override {
    std::unique_lock lock(bench_->mutex);
    if (bench_->block_grab) {
      bench_->blocked = true;
      bench_->changed.notify_all();
      bench_->changed.wait(lock, [&] { return bench_->interrupted; });
      throw DeviceError(Reason::kFrameMissing, "fake", "grab", "interrupted");
    }
    if (bench_->failing) throw DeviceError(bench_->reason, "fake", "grab", "no trigger came");
    Frame frame;
    frame.image = cv::Mat::zeros(2, 2, CV_8UC1);
    return frame;
  }
  void Disarm() noexcept override { bench_->armed = 0; }
  void Interrupt() noexcept override {
    const std::scoped_lock lock(bench_->mutex);
    bench_->interrupted = true;
    bench_->changed.notify_all();
  }

 private:
  std::shared_ptr<FakeBench> bench_;
};

class FakeProjector : public Projector {
 public:
  explicit FakeProjector(std::shared_ptr<FakeBench> bench) : bench_(std::move(bench)) {}
  LitInterval Pulse(std::chrono::microseconds width, const std::function<void()>&) override {
    ++bench_->pulses;
    return {UtcTime{}, UtcTime{width}};
  }

 private:
  std::shared_ptr<FakeBench> bench_;
};

/// An OpenRig that opens fakes on `bench`; each rig closes as two cameras do. The time of frames is left to the rig.
inline auto FakeOpener(std::shared_ptr<FakeBench> bench, const Clock& clock) {
  return [bench = std::move(bench), &clock](const RigOptions&, const RigWorld&) {
    ++bench->opens;
    if (bench->failing_opens > 0) {
      --bench->failing_opens;
      throw DeviceError(Reason::kCameraUnavailable, "fake", "open", "no such device");
    }
    return Rig(std::make_unique<FakeCamera>(bench), std::make_unique<FakeCamera>(bench),
               std::make_unique<FakeProjector>(bench), CaptureOptions{}, [&clock] { return clock.Now(); });
  };
}

class FakePublisher : public Publisher {
 public:
  [[nodiscard]] std::string_view Name() const override { return "fake"; }
  void Publish(const BinSnapshot& snapshot) override {
    const std::scoped_lock lock(mutex_);
    snapshots.push_back(snapshot);
    changed_.notify_all();
  }
  /// Blocks until the newest snapshot is as wanted; @return it, or empty after a minute, which is a hang.
  template <typename Wanted>
  [[nodiscard]] std::optional<BinSnapshot> Await(Wanted wanted) {
    std::unique_lock lock(mutex_);
    const bool came = changed_.wait_for(lock, std::chrono::minutes{1},
                                        [&] { return !snapshots.empty() && wanted(snapshots.back()); });
    return came ? std::optional(snapshots.back()) : std::nullopt;
  }
  std::vector<BinSnapshot> snapshots;  ///< to be read while nobody publishes

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
};

/// A valid measurement of this volume, ±0.0001 m³.
inline Measurement Valid(double volume_m3, UtcTime utc = {}) {
  Measurement m;
  m.valid = true;
  m.reason = Reason::kOk;
  m.volume_m3 = volume_m3;
  m.volume_u95_m3 = 0.0001;
  m.utc = utc;
  return m;
}

/// A poor picture's verdict.
inline Measurement Verdict(Reason reason) {
  Measurement m;
  m.reason = reason;
  m.detail = "as the test wants it";
  return m;
}

}  // namespace granary
