// How cameras, projector and rig are chosen and set.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace granary {

enum class CameraDriver { kAravis, kV4l2, kReplay, kSim };
enum class ProjectorDriver { kGpio, kSim, kNone };
enum class TriggerMode { kLine0, kSoftware, kFree };

/// A GenICam feature or V4L2 control by its own name, with the value to set.
using Feature = std::pair<std::string, std::variant<bool, std::int64_t, double, std::string>>;

struct CameraOptions {
  CameraDriver driver = CameraDriver::kSim;
  std::string id;  ///< serial, MAC or IP; /dev/v4l/by-path/…; empty for replay and sim
  double exposure_us = 8000;
  double gain_db = 0;
  std::optional<TriggerMode> trigger;        ///< empty: see TriggerOf
  std::vector<std::filesystem::path> files;  ///< replay only, used in turn, round and round
  std::string pixel_format;                  ///< GenICam or four-character V4L2 name; empty: the driver's choice
  std::vector<int> roi_px;                   ///< x, y, width, height; empty: the calibration's size from (0, 0)
  std::vector<Feature> features;             ///< set in this order after all else, and read back
  // GigE Vision only:
  int packet_size = 0;  ///< bytes; 0: the largest that the link carries
  std::optional<int>
      packet_delay_ns;           ///< pause between packets; empty: what leaves both cameras their share of the link
  bool resend = true;            ///< lost packets are asked for again
  int socket_buffer_kib = 4096;  ///< of the stream's socket
  bool ptp = false;              ///< the camera's clock follows PTP, and must be locked to it
};

struct ProjectorOptions {
  ProjectorDriver driver = ProjectorDriver::kNone;
  std::string chip;  ///< /dev/gpiochipN or its label
  int line = 0;
  std::string line_name;    ///< in place of the offset; empty: the offset counts
  bool active_low = false;  ///< the line is low while the projector is lit
  /// A second line that triggers the cameras, `settle` after the projector's; -1 and empty: one line drives both.
  int trigger_line = -1;
  std::string trigger_line_name;
  std::chrono::microseconds settle{200};
  std::chrono::milliseconds max_on{50};  ///< the projector is never lit longer than this
  double max_duty_percent = 10;          ///< nor for a greater share of any ten seconds
  [[nodiscard]] bool HasTriggerLine() const { return trigger_line >= 0 || !trigger_line_name.empty(); }
};

/// The shapes of the paper's study (METHOD §8).
enum class SimShape { kFlat, kTiltedLeft, kTiltedRight, kConvex, kConcave, kPartial };
/// What the simulated bin does from one measurement to the next.
enum class SimMotion { kStill, kFilling, kDraining, kCycle };

/// The simulated bin and its light. Used when a rig's cameras say driver = "sim".
struct SimOptions {
  SimShape shape = SimShape::kConvex;
  SimMotion motion = SimMotion::kStill;
  double volume_m3 = 0.019;     ///< grain at the first measurement; the scene holds exactly this
  double volume_step_m3 = 0.0;  ///< added (filling) or taken (draining) at each measurement
  std::uint64_t seed = 1;       ///< of grain texture, dots and noise; equal seeds give equal frames
  double full_well_e = 9000;    ///< electrons at full scale: sets the shot noise
  double read_noise_e = 12;
  double ambient = 0.16;        ///< room light as a share of the projector's, uneven
  bool projector_works = true;  ///< false: the lamp is dead, frames show ambient light only
};

struct RigOptions {
  std::string name = "a";
  std::filesystem::path calibration;  ///< stereo.yml
  std::filesystem::path pose;         ///< world.yml
  std::chrono::microseconds max_skew{500};
  bool ambient = false;  ///< a second pair with the projector dark, taken off the first
  /// Pairs taken and thrown away after idling; empty: 1 with aravis or v4l2 cameras, else 0.
  std::optional<int> warmup_pairs;
  /// Most shorter exposures, each a quarter of the one before, added while a picture saturates; empty: 2 with aravis
  /// or v4l2 cameras, else 0.
  std::optional<int> exposure_brackets;
  CameraOptions left, right;
  ProjectorOptions projector;
  SimOptions sim;
};

/// What starts the camera's exposures: its own `trigger`, else line0 with a GPIO projector, else software (a V4L2 node,
/// which knows none: free).
[[nodiscard]] TriggerMode TriggerOf(const CameraOptions& camera, const ProjectorOptions& projector);
/// A camera that is there in the flesh: aravis or v4l2.
[[nodiscard]] bool IsDevice(const CameraOptions& camera);
[[nodiscard]] int WarmupPairs(const RigOptions& options);
[[nodiscard]] int ExposureBrackets(const RigOptions& options);

/// How long the projector is lit: settled, then on for the longer of the two exposures; as long as it may be under a
/// GPIO projector where a camera runs free or waits for a command, for a whole exposure has to fall inside.
[[nodiscard]] std::chrono::microseconds PulseWidth(const RigOptions& options);

/// What is wrong with the options: one "key: what, what is allowed" each, keys as in the configuration file; empty when
/// all is well. A rig's faults are its own and those between its parts ("right.driver: …"), not those of each part.
[[nodiscard]] std::vector<std::string> Faults(const CameraOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const ProjectorOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const SimOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const RigOptions& options);

}  // namespace granary
