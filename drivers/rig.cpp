// One pulse makes one pair. Whatever goes wrong on the way, the cameras are disarmed when CapturePair is left; the
// projector sees to its own darkness.
#include "drivers/rig.h"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "drivers/camera_replay.h"
#include "drivers/errors.h"
#include "drivers/sim/bench.h"
#include "drivers/sim/camera_sim.h"
#include "drivers/sim/projector_sim.h"

namespace granary {
namespace {

// Beyond the pulse: transfer of the frame over a slow link, and the camera's own delays.
constexpr std::chrono::milliseconds kTransferTime{1500};

class DisarmOnExit {
 public:
  DisarmOnExit(Camera& left, Camera& right) : left_(left), right_(right) {}
  ~DisarmOnExit() {
    left_.Disarm();
    right_.Disarm();
  }
  DisarmOnExit(const DisarmOnExit&) = delete;
  DisarmOnExit& operator=(const DisarmOnExit&) = delete;

 private:
  Camera& left_;
  Camera& right_;
};

std::string PairName(const Camera& left, const Camera& right) { return left.Id() + " and " + right.Id(); }

void RequirePicture(const Camera& camera, const Frame& frame) {
  if (frame.image.empty()) throw DeviceError(Reason::kFrameMissing, camera.Id(), "grab", "the frame has no pixels");
}

std::unique_ptr<Camera> OpenRealCamera(const CameraOptions& options, const std::string& side) {
  const auto absent = [&](const std::string& driver) {
    return std::invalid_argument(side + ".driver: this build has no driver \"" + driver +
                                 "\" for cameras yet, allowed are \"replay\" and \"sim\"");
  };
  switch (options.driver) {
    case CameraDriver::kAravis:
      throw absent("aravis");
    case CameraDriver::kV4l2:
      throw absent("v4l2");
    case CameraDriver::kReplay:
      return std::make_unique<CameraReplay>(options.files);
    case CameraDriver::kSim:
      break;
  }
  throw std::logic_error("OpenRealCamera: no such driver");
}

}  // namespace

Rig::Rig(std::unique_ptr<Camera> left, std::unique_ptr<Camera> right, std::unique_ptr<Projector> projector,
         std::chrono::microseconds max_skew, std::chrono::microseconds pulse_width, Clock now)
    : left_(std::move(left)),
      right_(std::move(right)),
      projector_(std::move(projector)),
      max_skew_(max_skew),
      pulse_width_(pulse_width),
      now_(std::move(now)) {}

FramePair Rig::CapturePair() {
  const DisarmOnExit disarm(*left_, *right_);
  const auto last_ids = std::exchange(last_ids_, std::nullopt);
  left_->Arm();
  right_->Arm();
  const UtcTime triggered = now_();
  if (projector_) projector_->Pulse(pulse_width_);

  const auto timeout = kTransferTime + std::chrono::ceil<std::chrono::milliseconds>(pulse_width_);
  FramePair pair;
  pair.left = left_->Grab(timeout);
  pair.right = right_->Grab(timeout);
  RequirePicture(*left_, pair.left);
  RequirePicture(*right_, pair.right);
  last_ids_ = {pair.left.frame_id, pair.right.frame_id};

  // A counter that did not go up does not count, or began anew.
  if (last_ids && pair.left.frame_id > last_ids->first && pair.right.frame_id > last_ids->second) {
    const auto left_by = pair.left.frame_id - last_ids->first, right_by = pair.right.frame_id - last_ids->second;
    if (left_by != right_by) {
      throw DeviceError(Reason::kFrameMissing, PairName(*left_, *right_), "match",
                        "frames of different triggers: since the last pair the left camera counted " +
                            std::to_string(left_by) + ", the right one " + std::to_string(right_by));
    }
  }

  const bool left_timed = pair.left.exposure_start != UtcTime{}, right_timed = pair.right.exposure_start != UtcTime{};
  if (left_timed && right_timed) {
    const auto apart = pair.left.exposure_start - pair.right.exposure_start;
    pair.skew = std::chrono::ceil<std::chrono::microseconds>(std::chrono::abs(apart));
    if (pair.skew > max_skew_) {
      throw DeviceError(Reason::kSkewTooLarge, PairName(*left_, *right_), "match",
                        "the exposures started " + std::to_string(pair.skew.count()) + " us apart, allowed is " +
                            std::to_string(max_skew_.count()) + " us");
    }
  }
  if (!left_timed) pair.left.exposure_start = triggered;
  if (!right_timed) pair.right.exposure_start = triggered;
  if (!left_timed && !right_timed && pair.left.image.depth() == CV_16U && pair.right.image.depth() == CV_16U) {
    // Files tell the bits of a pixel no more than the time: LoadFrame takes them from the brightest pixel, and the two
    // may fall to different sides of a power of two.
    pair.left.bit_depth = pair.right.bit_depth = std::max(pair.left.bit_depth, pair.right.bit_depth);
  }
  return pair;
}

void Rig::Interrupt() noexcept {
  left_->Interrupt();
  right_->Interrupt();
}

Rig OpenRig(const RigOptions& options, const RigWorld& world) {
  const bool left_sim = options.left.driver == CameraDriver::kSim;
  if (left_sim != (options.right.driver == CameraDriver::kSim)) {
    throw std::invalid_argument("left.driver, right.driver: \"sim\" is for both cameras or neither");
  }
  if (!left_sim && options.projector.driver == ProjectorDriver::kSim) {
    throw std::invalid_argument("projector.driver: \"sim\" lights simulated cameras only, allowed is \"none\"");
  }
  if (options.projector.driver == ProjectorDriver::kGpio) {
    throw std::invalid_argument(
        "projector.driver: this build has no driver \"gpio\" yet, allowed are \"sim\" and \"none\"");
  }

  std::unique_ptr<Camera> left, right;
  std::unique_ptr<Projector> projector;
  if (left_sim) {
    const auto bench = std::make_shared<SimBench>(options.sim, world);
    left = std::make_unique<CameraSim>(bench, Side::kLeft, options.left);
    right = std::make_unique<CameraSim>(bench, Side::kRight, options.right);
    if (options.projector.driver == ProjectorDriver::kSim) {
      projector = std::make_unique<ProjectorSim>(bench, options.projector);
    }
  } else {
    left = OpenRealCamera(options.left, "left");
    right = OpenRealCamera(options.right, "right");
  }
  return Rig(std::move(left), std::move(right), std::move(projector), options.max_skew, PulseWidth(options));
}

}  // namespace granary
