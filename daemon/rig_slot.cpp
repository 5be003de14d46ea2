// A device in trouble is closed whole and opened anew: half-reset cameras are the ones that never come back.
#include "daemon/rig_slot.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace granary {

std::chrono::seconds ReopenDelay(int failures) {
  if (failures <= 0) return std::chrono::seconds{0};
  return std::chrono::seconds{failures > 5 ? 30 : std::min(30, 1 << (failures - 1))};
}

RigSlot::RigSlot(RigPlan plan, RigOpener open, Clock& clock)
    : plan_(std::move(plan)), open_(std::move(open)), clock_(clock) {}

FramePair RigSlot::Capture() {
  if (!rig_) {
    if (clock_.Steady() < not_before_)
      throw DeviceError(reason_, "rig " + plan_.options.name, "closed after", trouble_);
    Open();
  }
  try {
    FramePair pair = rig_->CapturePair();
    failures_ = 0;
    trouble_.clear();
    return pair;
  } catch (const DeviceError& error) {
    Fail(error.reason(), error.what());
    throw;
  }
}

bool RigSlot::ReopenIfDue() {
  if (rig_ || failures_ == 0 || clock_.Steady() < not_before_) return false;
  try {
    Open();
    return true;
  } catch (const DeviceError&) {
    return false;  // Open has noted it
  }
}

void RigSlot::Open() {
  if (rig_) return;
  try {
    Rig rig = open_(plan_.options, plan_.world);
    const std::scoped_lock lock(mutex_);
    rig_.emplace(std::move(rig));
    if (failures_ > 0) ++reopened_;
  } catch (const DeviceError& error) {
    Fail(error.reason(), error.what());
    throw;
  } catch (const std::invalid_argument& error) {
    // Options that no device can be opened with: the rig has no figure until they are mended, the other bins go on.
    Fail(Reason::kCameraUnavailable, error.what());
    throw DeviceError(reason_, "rig " + plan_.options.name, "open", error.what());
  }
}

void RigSlot::Fail(Reason reason, const std::string& words) {
  Close();
  reason_ = reason;
  trouble_ = words;
  not_before_ = clock_.Steady() + ReopenDelay(++failures_);
}

void RigSlot::Close() noexcept {
  std::optional<Rig> closing;
  {
    const std::scoped_lock lock(mutex_);
    closing.swap(rig_);
  }
  if (closing) closed_counters_ += closing->counters();
}

RigCounters RigSlot::counters() const {
  RigCounters counters = closed_counters_;
  if (rig_) counters += rig_->counters();
  return counters;
}

void RigSlot::Interrupt() noexcept {
  const std::scoped_lock lock(mutex_);
  if (rig_) rig_->Interrupt();
}

}  // namespace granary
