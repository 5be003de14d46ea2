// The checks of the options, worded as the configuration file's reader hands them on.
#include "drivers/options.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace granary {
namespace {

class FaultList {
 public:
  void Require(bool ok, const char* words) {
    if (!ok) faults_.emplace_back(words);
  }
  [[nodiscard]] std::vector<std::string> Take() { return std::move(faults_); }

 private:
  std::vector<std::string> faults_;
};

constexpr double kLongestExposure_us = 1e6;

}  // namespace

TriggerMode TriggerOf(const CameraOptions& camera, const ProjectorOptions& projector) {
  if (camera.trigger) return *camera.trigger;
  if (projector.driver == ProjectorDriver::kGpio) return TriggerMode::kLine0;
  return camera.driver == CameraDriver::kV4l2 ? TriggerMode::kFree : TriggerMode::kSoftware;
}

bool IsDevice(const CameraOptions& camera) {
  return camera.driver == CameraDriver::kAravis || camera.driver == CameraDriver::kV4l2;
}

int WarmupPairs(const RigOptions& options) {
  return options.warmup_pairs.value_or(IsDevice(options.left) || IsDevice(options.right) ? 1 : 0);
}

int ExposureBrackets(const RigOptions& options) {
  return options.exposure_brackets.value_or(IsDevice(options.left) && IsDevice(options.right) ? 2 : 0);
}

std::chrono::microseconds PulseWidth(const RigOptions& options) {
  const auto by_line = [&](const CameraOptions& camera) {
    return TriggerOf(camera, options.projector) == TriggerMode::kLine0;
  };
  const bool gpio = options.projector.driver == ProjectorDriver::kGpio;
  if (gpio && !(by_line(options.left) && by_line(options.right))) return options.projector.max_on;
  const double exposure_us = std::max(options.left.exposure_us, options.right.exposure_us);
  return options.projector.settle + std::chrono::microseconds(std::llround(std::ceil(exposure_us)));
}

std::vector<std::string> Faults(const CameraOptions& options) {
  FaultList faults;
  faults.Require(!IsDevice(options) || !options.id.empty(),
                 "id: is missing; aravis and v4l2 need the id that `granaryctl cameras` lists");
  faults.Require(options.exposure_us >= 1 && options.exposure_us <= kLongestExposure_us,
                 "exposure_us: must be 1 to 1000000");
  faults.Require(options.gain_db >= 0 && options.gain_db <= 48, "gain_db: must be 0 to 48");
  faults.Require(options.driver != CameraDriver::kReplay || !options.files.empty(),
                 "files: must name at least one picture when driver = \"replay\"");
  faults.Require(options.driver == CameraDriver::kReplay || options.files.empty(),
                 "files: must be absent unless driver = \"replay\"");
  const auto& roi = options.roi_px;
  faults.Require(roi.empty() || (roi.size() == 4 && roi[0] >= 0 && roi[1] >= 0 && roi[2] > 0 && roi[3] > 0 &&
                                 *std::max_element(roi.begin(), roi.end()) <= 65535),
                 "roi_px: must be [x, y, width, height] in whole pixels, 0 to 65535, width and height at least 1");
  faults.Require(options.packet_size == 0 || (options.packet_size >= 220 && options.packet_size <= 16260),
                 "packet_size: must be 0 (found out) or 220 to 16260");
  faults.Require(!options.packet_delay_ns || (*options.packet_delay_ns >= 0 && *options.packet_delay_ns <= 100'000'000),
                 "packet_delay_ns: must be 0 to 100000000");
  faults.Require(options.socket_buffer_kib >= 64 && options.socket_buffer_kib <= 1'048'576,
                 "socket_buffer_kib: must be 64 to 1048576");
  faults.Require(options.driver != CameraDriver::kV4l2 || options.trigger != TriggerMode::kSoftware,
                 "trigger: must be line0 or free when driver = \"v4l2\", a node knows no command for it");
  faults.Require(IsDevice(options) || options.features.empty(),
                 "features: must be absent unless driver = \"aravis\" or \"v4l2\"");
  faults.Require(!options.ptp || options.driver == CameraDriver::kAravis,
                 "ptp: must be false unless driver = \"aravis\"");
  return faults.Take();
}

std::vector<std::string> Faults(const ProjectorOptions& options) {
  FaultList faults;
  faults.Require(options.driver != ProjectorDriver::kGpio || !options.chip.empty(),
                 "chip: is missing; gpio needs the chip's device or label");
  faults.Require(options.line >= 0 && options.line <= 1023, "line: must be 0 to 1023");
  faults.Require(options.settle >= std::chrono::microseconds(0) && options.settle <= std::chrono::microseconds(100000),
                 "settle_us: must be 0 to 100000");
  faults.Require(options.max_on >= std::chrono::milliseconds(1) && options.max_on <= std::chrono::milliseconds(1000),
                 "max_on_ms: must be 1 to 1000");
  faults.Require(options.max_duty_percent > 0 && options.max_duty_percent <= 100,
                 "max_duty_percent: must be more than 0, up to 100");
  faults.Require(options.trigger_line >= -1 && options.trigger_line <= 1023,
                 "trigger_line: must be 0 to 1023, or -1 for none");
  faults.Require(options.trigger_line < 0 || options.trigger_line != options.line || !options.line_name.empty(),
                 "trigger_line: must be another line than the projector's, or absent for one line that drives both");
  return faults.Take();
}

std::vector<std::string> Faults(const SimOptions& options) {
  FaultList faults;
  const auto finite_from_0 = [](double value) { return std::isfinite(value) && value >= 0; };
  faults.Require(finite_from_0(options.volume_m3), "volume_m3: must be 0 up to what the bin holds");
  faults.Require(finite_from_0(options.volume_step_m3), "volume_step_m3: must not be negative");
  faults.Require(options.motion == SimMotion::kStill || options.volume_step_m3 != 0,
                 "volume_step_m3: must be more than 0 when motion is not \"still\"");
  faults.Require(options.full_well_e >= 100 && options.full_well_e <= 1e6, "full_well_e: must be 100 to 1000000");
  faults.Require(options.read_noise_e >= 0 && options.read_noise_e <= 1000, "read_noise_e: must be 0 to 1000");
  faults.Require(options.ambient >= 0 && options.ambient <= 2, "ambient: must be 0 to 2");
  return faults.Take();
}

std::vector<std::string> Faults(const RigOptions& options) {
  FaultList faults;
  faults.Require(!options.name.empty(), "name: must not be empty");
  faults.Require(options.max_skew >= std::chrono::microseconds(0) && options.max_skew <= std::chrono::seconds(1),
                 "max_skew_us: must be 0 to 1000000");

  const bool left_sim = options.left.driver == CameraDriver::kSim;
  const bool right_sim = options.right.driver == CameraDriver::kSim;
  faults.Require(!IsDevice(options.left) || options.left.driver != options.right.driver || options.left.id.empty() ||
                     options.left.id != options.right.id,
                 "right.id: is the left camera's; must be another one");
  faults.Require(left_sim == right_sim, "right.driver: \"sim\" must be both cameras' driver or neither's");
  faults.Require(options.projector.driver != ProjectorDriver::kSim || (left_sim && right_sim),
                 "projector.driver: \"sim\" lights simulated cameras only; must be gpio or none");
  faults.Require(options.projector.driver != ProjectorDriver::kGpio || !(left_sim || right_sim),
                 "projector.driver: \"gpio\" does not light simulated cameras; must be sim or none");
  if (options.left.driver == CameraDriver::kReplay && options.right.driver == CameraDriver::kReplay) {
    faults.Require(options.left.files.size() == options.right.files.size(),
                   "right.files: must be as many pictures as left.files, one for each pair");
  }
  faults.Require(!options.warmup_pairs || (*options.warmup_pairs >= 0 && *options.warmup_pairs <= 20),
                 "warmup_pairs: must be 0 to 20");
  faults.Require(!options.exposure_brackets || (*options.exposure_brackets >= 0 && *options.exposure_brackets <= 3),
                 "exposure_brackets: must be 0 to 3");
  const bool from_files = options.left.driver == CameraDriver::kReplay || options.right.driver == CameraDriver::kReplay;
  faults.Require(!from_files || options.exposure_brackets.value_or(0) == 0,
                 "exposure_brackets: must be 0 with a replay camera, whose exposure cannot be set");
  const auto needs_light = [&](const CameraOptions& camera) {
    return TriggerOf(camera, options.projector) == TriggerMode::kLine0 && !options.projector.HasTriggerLine();
  };
  faults.Require(
      !options.ambient || from_files || left_sim || !(needs_light(options.left) || needs_light(options.right)),
      "ambient: must be false where one line lights the projector and triggers the cameras; give "
      "projector.trigger_line, or another trigger");
  faults.Require(!options.ambient || !from_files, "ambient: must be false with a replay camera");
  // The exposures are judged only where they are possible at all; their own faults say the rest.
  const bool judged =
      Faults(options.left).empty() && Faults(options.right).empty() && Faults(options.projector).empty();
  if (judged && options.projector.driver != ProjectorDriver::kNone) {
    faults.Require(PulseWidth(options) <= options.projector.max_on,
                   "projector.max_on_ms: must be at least settle_us plus the longer exposure_us");
  }
  return faults.Take();
}

}  // namespace granary
