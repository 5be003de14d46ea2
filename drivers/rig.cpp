// One pulse makes one pair. Whatever goes wrong on the way, the cameras are disarmed when a pair is left; the projector
// sees to its own darkness.
#include "drivers/rig.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include <spdlog/spdlog.h>
#include <opencv2/core.hpp>

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

// Room light flickers by some percent from one picture to the next; a projector that adds no more than a tenth to it is
// none to measure by.
constexpr double kLeastLight = 1.1;

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
  capture.brackets_asked_for = options.exposure_brackets.value_or(0) > 0;
  return capture;
}

RigCounters& RigCounters::operator+=(const RigCounters& other) {
  pulses += other.pulses;
  pairs += other.pairs;
  for (std::size_t side = 0; side < 2; ++side) missed_frames.at(side) += other.missed_frames.at(side);
  mismatched += other.mismatched;
  return *this;
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
  auto [pair, taken, needed] = TakeBrackets(Light::kLit, brackets_, options_.exposure_brackets);
  brackets_ = needed;
  if (options_.ambient) {
    FramePair dark = TakeBrackets(Light::kDark, taken, taken).pair;  // merged as the lit one was
    pair.ambient_left = std::move(dark.left);
    pair.ambient_right = std::move(dark.right);
    if (projector_) ConfirmLight(pair);
  }
  ++counters_.pairs;
  return std::move(pair);
}

void Rig::ConfirmLight(const FramePair& pair) {
  const auto grey = [](const Frame& frame) { return cv::mean(frame.image)[0]; };
  const double left = grey(pair.left), right = grey(pair.right);
  const double dark_left = grey(*pair.ambient_left), dark_right = grey(*pair.ambient_right);
  if (left > kLeastLight * dark_left || right > kLeastLight * dark_right) return;
  throw DeviceError(Reason::kProjectorDark, "projector", "light",
                    "the pictures are no brighter than with the projector off: mean grey left " + std::to_string(left) +
                        " against " + std::to_string(dark_left) + ", right " + std::to_string(right) + " against " +
                        std::to_string(dark_right));
}

void Rig::WarmUp() {
  if (options_.warmup_pairs == 0 || (before_ && steady_() - before_->taken < kIdleTime)) return;
  for (int i = 0; i < options_.warmup_pairs; ++i) {
    try {
      (void)TakePair(Light::kLit);
    } catch (const DeviceError& error) {
      if (!IsFleeting(error.reason())) throw;  // what first frames after idling may do with nothing broken
      spdlog::debug("while warming up: {}", error.what());
    }
  }
}

Rig::Bracketed Rig::TakeBrackets(Light light, int least, int most) {
  std::vector<Frame> lefts, rights;
  Bracketed result;
  double divisor = 1;
  for (int taken = 0;; ++taken, divisor *= kBracketRatio) {
    if (options_.exposure_brackets > 0 && !SetExposures(divisor)) options_.exposure_brackets = least = most = 0;
    FramePair next = TakePair(light);
    if (taken == 0) result.pair = next;
    const double saturated = std::max(SaturatedShare(next.left), SaturatedShare(next.right));
    if (saturated > (taken < least ? kUnsaturatedShare : kSaturatedShare)) result.needed = std::min(taken + 1, most);
    lefts.push_back(std::move(next.left));
    rights.push_back(std::move(next.right));
    if (taken >= std::max(least, result.needed)) break;
  }
  result.taken = static_cast<int>(lefts.size()) - 1;
  result.pair.left = MergeBrackets(lefts);
  result.pair.right = MergeBrackets(rights);
  return result;
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

/// Of a triggered camera every frame after the one before counts one trigger. A frame of the number 0 does not count,
/// and a number that went down began anew.
void Rig::CheckCounters(const PairMarks& before) {
  std::array<std::optional<std::int64_t>, 2> advances;
  for (std::size_t side = 0; side < 2; ++side) {
    const std::uint64_t id = before_->ids.at(side), then = before.ids.at(side);
    const bool counts = options_.trigger.at(side) != TriggerMode::kFree && id != 0 && then != 0;
    if (counts) advances.at(side) = static_cast<std::int64_t>(id - then);
  }
  const auto refuse = [this](Reason reason, const std::string& who, const std::string& words) {
    ++counters_.mismatched;
    throw DeviceError(reason, who, "match", words);
  };
  const auto& [left, right] = advances;
  if (left && right && *left != *right && (*left >= 0 || *right >= 0)) {
    refuse(Reason::kFrameMissing, PairName(),
           "frames of different triggers: since the last pair the left camera counted " + std::to_string(*left) +
               ", the right one " + std::to_string(*right));
  }
  for (std::size_t side = 0; side < 2; ++side) {
    if (!advances.at(side) || *advances.at(side) == 1 || *advances.at(side) < 0) continue;
    const std::string who = cameras_.at(side)->Id();
    if (*advances.at(side) == 0) refuse(Reason::kFrameMissing, who, "the frame of the last pair came once more");
    refuse(Reason::kStrayTrigger, who,
           "the camera counted " + std::to_string(*advances.at(side)) + " triggers, one was given");
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

bool Rig::SetExposures(double divisor) {
  for (std::size_t side = 0; side < 2; ++side) {
    Camera& camera = *cameras_.at(side);
    if (camera.SetExposure(options_.exposure_us.at(side) / divisor)) continue;
    if (!options_.brackets_asked_for) return false;
    throw DeviceError(Reason::kSettingRefused, camera.Id(), "set the exposure",
                      "exposure_brackets: must be 0 for this camera, its exposure cannot be set");
  }
  return true;
}

std::string Rig::PairName() const { return cameras_[0]->Id() + " and " + cameras_[1]->Id(); }

void Rig::Interrupt() noexcept {
  for (auto& camera : cameras_) camera->Interrupt();
}

}  // namespace granary
