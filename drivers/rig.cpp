// One pulse makes one pair. Whatever goes wrong on the way, the cameras are disarmed when a pair is left; the projector
// sees to its own darkness.
#include "drivers/rig.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include <spdlog/spdlog.h>

#include "drivers/errors.h"
#include "drivers/exposure.h"

namespace granary {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

// Beyond the pulse: transfer of the frame over a slow link, and the camera's own delays.
constexpr milliseconds kTransferTime{1500};
// When one camera gave no frame, the other is asked as well, to tell a dead camera from a dead trigger.
constexpr milliseconds kOtherCameraTime{100};
// After this long a camera's first frames are not to be trusted.
constexpr std::chrono::seconds kIdleTime{10};
// Two crystals drift apart by up to 0.1 ms a second: cameras' own clocks tell little of longer times.
constexpr std::chrono::seconds kClocksAgreeFor{2};
// A picture with a larger share of full pixels gets a shorter exposure beside it; below the other the last one is not
// needed any more. The speckle's brightest dots may stay clipped.
constexpr double kSaturatedShare = 1e-3;
constexpr double kUnsaturatedShare = 2e-4;

class DisarmOnExit {
 public:
  explicit DisarmOnExit(std::array<std::unique_ptr<Camera>, 2>& cameras) : cameras_(cameras) {}
  ~DisarmOnExit() {
    for (auto& camera : cameras_) camera->Disarm();
  }
  DisarmOnExit(const DisarmOnExit&) = delete;
  DisarmOnExit& operator=(const DisarmOnExit&) = delete;

 private:
  std::array<std::unique_ptr<Camera>, 2>& cameras_;
};

bool IsTimed(const Frame& frame) { return frame.exposure_start != UtcTime{}; }

std::string Microseconds(std::chrono::nanoseconds duration) {
  return std::to_string(std::chrono::duration_cast<microseconds>(duration).count()) + " us";
}

/// True for what the first frames after idling may do without anything being broken.
bool IsWarmupTrouble(Reason reason) {
  return reason == Reason::kFrameMissing || reason == Reason::kFrameInvalid || reason == Reason::kSkewTooLarge ||
         reason == Reason::kStrayTrigger;
}

}  // namespace

CaptureOptions CaptureOptionsOf(const RigOptions& options) {
  CaptureOptions capture;
  capture.max_skew = options.max_skew;
  capture.pulse_width = PulseWidth(options);
  capture.trigger = {TriggerOf(options.left, options.projector), TriggerOf(options.right, options.projector)};
  capture.exposure_us = {options.left.exposure_us, options.right.exposure_us};
  capture.ambient = options.ambient;
  capture.warmup_pairs = WarmupPairs(options);
  capture.exposure_brackets = ExposureBrackets(options);
  return capture;
}

Rig::Rig(std::unique_ptr<Camera> left, std::unique_ptr<Camera> right, std::unique_ptr<Projector> projector,
         const CaptureOptions& options, UtcClock now, SteadyClock steady)
    : cameras_{std::move(left), std::move(right)},
      projector_(std::move(projector)),
      options_(options),
      now_(std::move(now)),
      steady_(std::move(steady)) {}

FramePair Rig::CapturePair() {
  WarmUp();
  FramePair pair = TakeBrackets(Light::kLit);
  if (options_.ambient) {
    FramePair dark = TakeBrackets(Light::kDark);
    pair.ambient_left = std::move(dark.left);
    pair.ambient_right = std::move(dark.right);
  }
  ++counters_.pairs;
  return pair;
}

void Rig::WarmUp() {
  if (options_.warmup_pairs == 0 || (before_ && steady_() - before_->taken < kIdleTime)) return;
  for (int i = 0; i < options_.warmup_pairs; ++i) {
    try {
      (void)TakePair(Light::kLit);
    } catch (const DeviceError& error) {
      if (!IsWarmupTrouble(error.reason())) throw;
      spdlog::debug("while warming up: {}", error.what());
    }
  }
}

FramePair Rig::TakeBrackets(Light light) {
  std::vector<Frame> lefts, rights;
  FramePair pair;
  double divisor = 1;
  int needed = 0;  // shorter exposures, as the pictures show
  for (int taken = 0;; ++taken, divisor *= kBracketRatio) {
    if (options_.exposure_brackets > 0) SetExposures(divisor);
    FramePair next = TakePair(light);
    if (taken == 0) pair = next;
    const double saturated = std::max(SaturatedShare(next.left), SaturatedShare(next.right));
    if (saturated > (taken < brackets_ ? kUnsaturatedShare : kSaturatedShare)) needed = taken + 1;
    lefts.push_back(std::move(next.left));
    rights.push_back(std::move(next.right));
    // The dark pair is merged as the lit one was.
    const int wanted = light == Light::kDark ? brackets_ : std::max(brackets_, needed);
    if (taken >= std::min(wanted, options_.exposure_brackets)) break;
  }
  if (light == Light::kLit) brackets_ = std::max(static_cast<int>(lefts.size()) - 1, 0);
  pair.left = MergeBrackets(lefts);
  pair.right = MergeBrackets(rights);
  return pair;
}

FramePair Rig::TakePair(Light light) {
  const DisarmOnExit disarm(cameras_);
  const auto before = std::exchange(before_, std::nullopt);
  for (auto& camera : cameras_) camera->Arm();
  const UtcTime triggered = now_();
  const auto lit = FireTrigger(light);

  FramePair pair;
  pair.left = GrabFrame(0, lit);
  pair.right = GrabFrame(1, lit);
  if (lit) pair.pulse = std::chrono::duration_cast<microseconds>(lit->until - lit->from);
  before_ =
      PairMarks{{pair.left.frame_id, pair.right.frame_id}, {pair.left.device_time, pair.right.device_time}, steady_()};
  if (before) CheckCounters(*before);
  pair.skew = SkewOf(pair, before);
  if (pair.skew && *pair.skew > options_.max_skew) {
    ++counters_.mismatched;
    throw DeviceError(Reason::kSkewTooLarge, PairName(), "match",
                      "the exposures started " + std::to_string(pair.skew->count()) + " us apart, allowed is " +
                          std::to_string(options_.max_skew.count()) + " us");
  }

  const bool left_timed = IsTimed(pair.left), right_timed = IsTimed(pair.right);
  if (!left_timed) pair.left.exposure_start = triggered;
  if (!right_timed) pair.right.exposure_start = triggered;
  if (!left_timed && !right_timed && pair.left.image.depth() == CV_16U && pair.right.image.depth() == CV_16U) {
    // Files tell the bits of a pixel no more than the time: LoadFrame takes them from the brightest pixel, and the two
    // may fall to different sides of a power of two.
    pair.left.bit_depth = pair.right.bit_depth = std::max(pair.left.bit_depth, pair.right.bit_depth);
  }
  return pair;
}

std::optional<LitInterval> Rig::FireTrigger(Light light) {
  const auto command = [this] {
    for (auto& camera : cameras_) camera->Trigger();
  };
  if (light == Light::kLit && projector_) {
    ++counters_.pulses;
    return projector_->Pulse(options_.pulse_width, command);
  }
  const bool by_line =
      std::find(options_.trigger.begin(), options_.trigger.end(), TriggerMode::kLine0) != options_.trigger.end();
  if (projector_ && by_line && !projector_->TriggerDark()) {
    throw DeviceError(Reason::kProjectorFault, "projector", "trigger in the dark",
                      "one line lights the projector and triggers the cameras");
  }
  command();
  return std::nullopt;
}

Frame Rig::GrabFrame(std::size_t side, const std::optional<LitInterval>& lit) {
  Camera& camera = *cameras_.at(side);
  const auto timeout = kTransferTime + std::chrono::ceil<milliseconds>(options_.pulse_width);
  const bool runs_free = options_.trigger.at(side) == TriggerMode::kFree;
  try {
    for (;;) {
      Frame frame = camera.Grab(timeout);
      if (frame.image.empty()) throw DeviceError(Reason::kFrameMissing, camera.Id(), "grab", "the frame has no pixels");
      if (!lit) return frame;
      if (runs_free) {
        if (!IsTimed(frame) || frame.exposure_end == UtcTime{}) {
          throw DeviceError(Reason::kFrameInvalid, camera.Id(), "match",
                            "the camera runs free and does not tell when it exposed; trigger it by line or command");
        }
        if (frame.exposure_start < lit->from) continue;
        if (frame.exposure_end > lit->until) {
          throw DeviceError(Reason::kFrameMissing, camera.Id(), "match",
                            "no whole exposure fell into the pulse of " + Microseconds(lit->until - lit->from) +
                                "; lengthen projector.max_on_ms or shorten exposure_us");
        }
      } else if (IsTimed(frame)) {
        CheckPulse(side, frame, *lit);
      }
      return frame;
    }
  } catch (const DeviceError& error) {
    if (error.reason() == Reason::kStrayTrigger) ++counters_.mismatched;
    if (error.reason() != Reason::kFrameMissing) throw;
    ++counters_.missed_frames.at(side);
    if (side == 1) throw;
    // Is it this camera, or the trigger of both?
    try {
      (void)cameras_[1]->Grab(kOtherCameraTime);
    } catch (const DeviceError&) {
      ++counters_.missed_frames[1];
      throw DeviceError(Reason::kFrameMissing, PairName(), "grab",
                        std::string("neither camera gave a frame: is it the trigger? (") + error.what() + ")");
    }
    throw;
  }
}

void Rig::CheckPulse(std::size_t side, const Frame& frame, const LitInterval& lit) const {
  const auto early = lit.from - frame.exposure_start, late = frame.exposure_end - lit.until;
  if (early <= options_.max_skew && late <= options_.max_skew) return;
  const Camera& camera = *cameras_.at(side);
  throw DeviceError(Reason::kStrayTrigger, camera.Id(), "match",
                    "the frame was exposed " +
                        (early > options_.max_skew ? "from " + Microseconds(early) + " before the pulse on"
                                                   : "until " + Microseconds(late) + " after the pulse") +
                        ", so it was not this pulse that triggered it");
}

/// A counter that did not go up does not count, or began anew.
void Rig::CheckCounters(const PairMarks& before) {
  const auto& ids = before_->ids;
  if (ids[0] <= before.ids[0] || ids[1] <= before.ids[1]) return;
  const auto left_by = ids[0] - before.ids[0], right_by = ids[1] - before.ids[1];
  const auto counts = [&](std::size_t side) { return options_.trigger.at(side) != TriggerMode::kFree; };
  const bool both_count = counts(0) && counts(1);
  if (both_count && left_by != right_by) {
    ++counters_.mismatched;
    throw DeviceError(Reason::kFrameMissing, PairName(), "match",
                      "frames of different triggers: since the last pair the left camera counted " +
                          std::to_string(left_by) + ", the right one " + std::to_string(right_by));
  }
  for (std::size_t side = 0; side < 2; ++side) {
    const auto by = side == 0 ? left_by : right_by;
    if (!counts(side) || by == 1) continue;
    ++counters_.mismatched;
    throw DeviceError(Reason::kStrayTrigger, cameras_.at(side)->Id(), "match",
                      "the camera counted " + std::to_string(by) + " triggers, one was given");
  }
}

std::optional<microseconds> Rig::SkewOf(const FramePair& pair, const std::optional<PairMarks>& before) const {
  if (IsTimed(pair.left) && IsTimed(pair.right)) {
    return std::chrono::ceil<microseconds>(std::chrono::abs(pair.left.exposure_start - pair.right.exposure_start));
  }
  if (!before || before_->taken - before->taken > kClocksAgreeFor) return std::nullopt;
  const auto& now = before_->device_times;
  const auto& then = before->device_times;
  if (!now[0] || !now[1] || !then[0] || !then[1]) return std::nullopt;
  return std::chrono::ceil<microseconds>(std::chrono::abs((*now[0] - *then[0]) - (*now[1] - *then[1])));
}

void Rig::SetExposures(double divisor) {
  for (std::size_t side = 0; side < 2; ++side) {
    if (!cameras_.at(side)->SetExposure(options_.exposure_us.at(side) / divisor)) {
      throw DeviceError(Reason::kSettingRefused, cameras_.at(side)->Id(), "set the exposure",
                        "exposure_brackets: must be 0 for this camera, its exposure cannot be set");
    }
  }
}

std::string Rig::PairName() const { return cameras_[0]->Id() + " and " + cameras_[1]->Id(); }

void Rig::Interrupt() noexcept {
  for (auto& camera : cameras_) camera->Interrupt();
}

}  // namespace granary
