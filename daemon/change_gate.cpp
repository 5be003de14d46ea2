// Grain cannot come or go faster than the conveyors carry it; a person or a tarpaulin in the view can.
#include "daemon/change_gate.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

namespace granary {
namespace {

constexpr std::size_t kAgreeingCycles = 3;

double JointUncertainty_m3(const Measurement& a, const Measurement& b, double share_if_unknown) {
  const auto of = [&](const Measurement& m) { return m.volume_u95_m3.value_or(share_if_unknown * *m.volume_m3); };
  return std::hypot(of(a), of(b));
}

}  // namespace

bool IsPlausibleChange(const Measurement& before, const Measurement& now, double max_rate_m3_h) {
  using Hours = std::chrono::duration<double, std::ratio<3600>>;
  // A clock that was set back gives no time for a change at all.
  const double elapsed_h = std::max(0.0, Hours(now.utc - before.utc).count());
  const double allowed_m3 = max_rate_m3_h * elapsed_h + JointUncertainty_m3(before, now, 0.0);
  return std::abs(*now.volume_m3 - *before.volume_m3) <= allowed_m3;
}

bool Agree(const Measurement& a, const Measurement& b) {
  return std::abs(*a.volume_m3 - *b.volume_m3) <= JointUncertainty_m3(a, b, 0.01);
}

ChangeGate::ChangeGate(std::optional<double> max_rate_m3_h, std::optional<Measurement> good)
    : max_rate_m3_h_(max_rate_m3_h), good_(std::move(good)) {}

bool ChangeGate::Admits(const Measurement& measurement) const {
  if (!max_rate_m3_h_ || !good_ || !good_->volume_m3 || !measurement.volume_m3) return true;
  if (IsPlausibleChange(*good_, measurement, *max_rate_m3_h_)) return true;
  return doubtful_.size() + 1 >= kAgreeingCycles &&
         std::all_of(doubtful_.begin(), doubtful_.end(), [&](const auto& other) { return Agree(other, measurement); });
}

void ChangeGate::Remember(const Measurement& measurement) {
  if (measurement.valid) {
    good_ = measurement;
    doubtful_.clear();
    return;
  }
  if (measurement.reason != Reason::kImplausibleChange || !measurement.volume_m3) return;
  const bool agrees =
      std::all_of(doubtful_.begin(), doubtful_.end(), [&](const auto& other) { return Agree(other, measurement); });
  if (!agrees) doubtful_.clear();
  doubtful_.push_back(measurement);
}

}  // namespace granary
