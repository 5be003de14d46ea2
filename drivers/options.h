// How cameras, projector and rig are chosen and set.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace granary {

enum class CameraDriver { kAravis, kV4l2, kReplay, kSim };
enum class ProjectorDriver { kGpio, kSim, kNone };
enum class TriggerMode { kLine0, kSoftware, kFree };

struct CameraOptions {
  CameraDriver driver = CameraDriver::kSim;
  std::string id;  ///< serial, /dev/v4l/by-path/…; empty for replay and sim
  double exposure_us = 8000;
  double gain_db = 0;
  std::optional<TriggerMode> trigger;        ///< empty: line0 with a GPIO projector, else software
  std::vector<std::filesystem::path> files;  ///< replay only, used in turn, round and round
};

struct ProjectorOptions {
  ProjectorDriver driver = ProjectorDriver::kNone;
  std::string chip;  ///< /dev/gpiochipN or its label
  int line = 0;
  std::chrono::microseconds settle{200};
  std::chrono::milliseconds max_on{50};  ///< the projector is never lit longer than this
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
  CameraOptions left, right;
  ProjectorOptions projector;
  SimOptions sim;
};

/// How long the projector is lit: settled, then on for the longer of the two exposures.
[[nodiscard]] std::chrono::microseconds PulseWidth(const RigOptions& options);

/// What is wrong with the options: one "key: what, what is allowed" each, keys as in the configuration file; empty when
/// all is well. A rig's faults are its own and those between its parts ("right.driver: …"), not those of each part.
[[nodiscard]] std::vector<std::string> Faults(const CameraOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const ProjectorOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const SimOptions& options);
[[nodiscard]] std::vector<std::string> Faults(const RigOptions& options);

}  // namespace granary
