// Cameras and a projector that obey their contracts and fail on request.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/camera.h"
#include "drivers/errors.h"
#include "drivers/projector.h"

namespace granary {

/// What happened, in order, over all fakes of a rig: "left arm", "projector pulse", …
using EventLog = std::vector<std::string>;

/// What a test sets and sees of a FakeCamera that a Rig owns.
struct FakeCameraState {
  std::string id;
  std::shared_ptr<EventLog> events;
  std::deque<Frame> frames;  ///< given in turn; none left: the frame is missing
  std::optional<Reason> fail_arm, fail_grab;
  /// Exposure can be set, and frames without end are as bright as it, without a pulse half as bright.
  std::optional<double> grey_per_us;
  double exposure_us = 0;
  bool note_triggers = false;
  bool block_grab = false;      ///< Grab waits for Interrupt
  std::promise<void> grabbing;  ///< set when a Grab that blocks has begun
  bool armed = false;
  std::mutex mutex;
  std::condition_variable changed;
  bool interrupted = false;
};

class FakeCamera final : public Camera {
 public:
  explicit FakeCamera(std::shared_ptr<FakeCameraState> state) : state_(std::move(state)) {}
  [[nodiscard]] std::string Id() const override { return state_->id; }
  void Arm() override {
    Note("arm");
    if (state_->fail_arm) throw DeviceError(*state_->fail_arm, Id(), "arm", "fails on request");
    state_->armed = true;
  }
  bool SetExposure(double exposure_us) override {
    state_->exposure_us = exposure_us;
    return state_->grey_per_us.has_value();
  }
  void Trigger() override {
    if (state_->note_triggers) Note("trigger");
  }
  [[nodiscard]] Frame Grab(std::chrono::milliseconds) override {
    Note("grab");
    if (state_->block_grab) {
      std::unique_lock lock(state_->mutex);
      state_->grabbing.set_value();
      state_->changed.wait(lock, [&] { return state_->interrupted; });
      throw DeviceError(Reason::kFrameMissing, Id(), "grab", "interrupted");
    }
    if (state_->fail_grab) throw DeviceError(*state_->fail_grab, Id(), "grab", "fails on request");
    if (state_->grey_per_us) {
      Frame frame;
      const auto& events = *state_->events;
      const auto armed = std::find(events.rbegin(), events.rend(), Id() + " arm");
      const bool lit = std::find(events.rbegin(), armed, "projector pulse") != armed;
      frame.image = cv::Mat(4, 6, CV_8UC1, cv::Scalar(*state_->grey_per_us * state_->exposure_us * (lit ? 1 : 0.5)));
      return frame;
    }
    if (state_->frames.empty()) throw DeviceError(Reason::kFrameMissing, Id(), "grab", "no frame in time");
    Frame frame = state_->frames.front();
    state_->frames.pop_front();
    return frame;
  }
  void Disarm() noexcept override {
    Note("disarm");
    state_->armed = false;
  }
  void Interrupt() noexcept override {
    {
      const std::lock_guard lock(state_->mutex);
      state_->interrupted = true;
    }
    state_->changed.notify_all();
  }

 private:
  void Note(const std::string& what) { state_->events->push_back(state_->id + " " + what); }
  std::shared_ptr<FakeCameraState> state_;
};

struct FakeProjectorState {
  std::shared_ptr<EventLog> events;
  std::optional<Reason> fail_pulse;
  std::chrono::microseconds max_on{50000};
  std::chrono::microseconds width{0};  ///< of the last pulse
  int pulses = 0;
  bool lit = false;
  bool has_trigger_line = false;
  UtcTime now{};  ///< the time of every pulse
};

class FakeProjector final : public Projector {
 public:
  explicit FakeProjector(std::shared_ptr<FakeProjectorState> state) : state_(std::move(state)) {}
  ~FakeProjector() override { state_->lit = false; }
  LitInterval Pulse(std::chrono::microseconds width, const std::function<void()>& lit) override {
    if (width > state_->max_on) throw std::invalid_argument("pulse too long");
    state_->events->push_back("projector pulse");
    state_->lit = true;
    state_->width = width;
    ++state_->pulses;
    if (lit) lit();
    state_->lit = false;
    if (state_->fail_pulse) throw DeviceError(*state_->fail_pulse, "projector", "pulse", "fails on request");
    return {state_->now, state_->now + width};
  }
  bool TriggerDark() override {
    if (state_->has_trigger_line) state_->events->push_back("dark trigger");
    return state_->has_trigger_line;
  }

 private:
  std::shared_ptr<FakeProjectorState> state_;
};

}  // namespace granary
