// Each state does one thing and names the next; all that can go wrong ends as a reason code in `outcome_`, and the
// gates alone decide whether it is tried again, published or held against.
#include "daemon/cycle.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <utility>

#include "drivers/errors.h"

namespace granary {
namespace {

constexpr std::array<std::string_view, 6> kNames{"idle", "capturing", "measuring", "judging", "retrying", "publishing"};

double Milliseconds(std::chrono::steady_clock::duration duration) {
  return std::chrono::duration<double, std::milli>(duration).count();
}

/// Start of the first exposure; `otherwise` where the frames (from files) do not know it.
UtcTime ExposureStart(const std::vector<Shot>& shots, UtcTime otherwise) {
  UtcTime first = UtcTime::max();
  for (const Shot& shot : shots) {
    for (const auto& pair : shot) first = std::min(first, pair.left.exposure_start);
  }
  return first == UtcTime::max() || first == UtcTime{} ? otherwise : first;
}

}  // namespace

std::string_view NameOf(CycleState state) { return kNames.at(static_cast<std::size_t>(state)); }

bool IsWorthRetrying(Reason reason) {
  const FaultKind kind = InfoOf(reason).kind;
  return kind == FaultKind::kCamera || kind == FaultKind::kProjector || kind == FaultKind::kPicture;
}

Cycle::Cycle(CycleOptions options, CycleSteps steps, Clock& clock, std::optional<Measurement> good)
    : options_(std::move(options)),
      steps_(std::move(steps)),
      clock_(clock),
      gate_(options_.max_rate_m3_h, std::move(good)) {}

std::optional<Measurement> Cycle::Run(const std::stop_token& stop, CycleKind kind) {
  Begin(kind);
  while (state_ != CycleState::kIdle) Step(stop);
  if (!published_) return std::nullopt;
  return outcome_;
}

void Cycle::Begin(CycleKind kind) {
  if (state_ != CycleState::kIdle) throw std::logic_error("a cycle was begun before the last one ended");
  kind_ = kind;
  attempt_ = 0;
  published_ = false;
  Enter(CycleState::kCapturing);
}

void Cycle::Step(const std::stop_token& stop) {
  switch (state_) {
    case CycleState::kIdle:
      return;
    case CycleState::kCapturing:
      if (stop.stop_requested()) return Enter(CycleState::kIdle);
      return Capture();
    case CycleState::kMeasuring:
      return Measure();
    case CycleState::kGating:
      return Judge(stop);
    case CycleState::kRetrying:
      return Enter(clock_.Wait(stop, options_.retry_delay) ? CycleState::kCapturing : CycleState::kIdle);
    case CycleState::kPublishing:
      gate_.Remember(outcome_);
      steps_.publish(outcome_);
      published_ = true;
      return Enter(CycleState::kIdle);
  }
}

void Cycle::Enter(CycleState state) {
  state_ = state;
  if (steps_.entered) steps_.entered(state);
}

void Cycle::Capture() {
  ++attempt_;
  began_ = clock_.Now();
  const auto start = clock_.Steady();
  try {
    shots_ = steps_.capture();
  } catch (const DeviceError& error) {
    Fail(error.reason(), error.what());
    return Enter(CycleState::kGating);
  }
  capture_ms_ = Milliseconds(clock_.Steady() - start);
  Enter(CycleState::kMeasuring);
}

void Cycle::Measure() {
  try {
    outcome_ = steps_.measure(shots_);
    outcome_.timings_ms.capture = capture_ms_;
    outcome_.timings_ms.total += capture_ms_;
    outcome_.utc = ExposureStart(shots_, began_);
    outcome_.simulated = std::any_of(shots_.begin(), shots_.end(), [](const Shot& shot) {
      return std::any_of(shot.begin(), shot.end(), [](const auto& pair) { return pair.Simulated(); });
    });
  } catch (const std::logic_error&) {
    throw;  // a bug: the process ends and is started anew
  } catch (const std::exception& error) {
    Fail(Reason::kInternal, error.what());
  }
  shots_.clear();
  Enter(CycleState::kGating);
}

void Cycle::Judge(const std::stop_token& stop) {
  if (outcome_.valid && !gate_.Admits(outcome_)) {
    const Measurement& good = *gate_.good();
    std::array<char, 160> words{};
    std::snprintf(words.data(), words.size(), "%.5g m³ after %.5g m³: faster than max_rate_m3_h = %.5g allows",
                  *outcome_.volume_m3, *good.volume_m3, *options_.max_rate_m3_h);
    outcome_.valid = false;
    outcome_.reason = Reason::kImplausibleChange;
    outcome_.detail = words.data();
  }
  if (outcome_.valid) return Enter(CycleState::kPublishing);
  // A capture that a stop interrupted says nothing about the devices.
  if (stop.stop_requested() || kind_ == CycleKind::kTrial) return Enter(CycleState::kIdle);
  const bool again = attempt_ < options_.attempts && IsWorthRetrying(outcome_.reason);
  Enter(again ? CycleState::kRetrying : CycleState::kPublishing);
}

void Cycle::Fail(Reason reason, std::string_view detail) {
  outcome_ = Measurement{};
  outcome_.utc = began_;
  outcome_.reason = reason;
  outcome_.detail = detail;
}

}  // namespace granary
