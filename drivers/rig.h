// One stereo pair under one projector: capture of one synchronised pair of frames.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "drivers/camera.h"
#include "drivers/options.h"
#include "drivers/projector.h"
#include "pipeline/types/bin.h"
#include "pipeline/types/calibration.h"
#include "pipeline/types/frame.h"
#include "pipeline/types/transform.h"

namespace granary {

/// What a simulated rig has to know of the world it stands in. Real ones take the size of their frames from the
/// calibration, and none of the rest.
struct RigWorld {
  Bin bin;
  StereoCalibration calibration;
  RigidTransform world_from_left = RigidTransform::Identity();
  bool empty_bin = false;  ///< the simulator shows the bin without grain (for taking the reference)
};

/// How a rig takes its pairs.
struct CaptureOptions {
  std::chrono::microseconds max_skew{500};      ///< largest difference of the two exposure starts
  std::chrono::microseconds pulse_width{8200};  ///< how long the projector is lit, at least the exposure
  std::array<TriggerMode, 2> trigger{TriggerMode::kSoftware, TriggerMode::kSoftware};  ///< left, right
  std::array<double, 2> exposure_us{8000, 8000};
  bool ambient = false;
  int warmup_pairs = 0;
  int exposure_brackets = 0;
  bool brackets_asked_for = false;  ///< a camera whose exposure cannot be set is an error, and not left as it is
};

/// What a rig's configuration says of taking pairs.
[[nodiscard]] CaptureOptions CaptureOptionsOf(const RigOptions& options);

/// What a rig has seen since it was opened.
struct RigCounters {
  std::uint64_t pulses = 0;                      ///< of the projector, warm-up and dark pairs included
  std::uint64_t pairs = 0;                       ///< whole pairs handed out
  std::array<std::uint64_t, 2> missed_frames{};  ///< triggers after which the left, the right camera gave no frame
  std::uint64_t mismatched = 0;                  ///< pairs refused since their frames did not belong together

  RigCounters& operator+=(const RigCounters& other);
};

/// Owned and used by one thread, but for Interrupt.
class Rig {
 public:
  using UtcClock = std::function<UtcTime()>;
  using SteadyClock = std::function<std::chrono::steady_clock::time_point()>;

  /// @param projector null: no pulse is given
  /// @param now       the time given to frames whose camera does not tell it
  /// @param steady    tells how long the rig has idled
  Rig(
      std::unique_ptr<Camera> left, std::unique_ptr<Camera> right, std::unique_ptr<Projector> projector,
      const CaptureOptions& options, UtcClock now = [] { return UtcTime(std::chrono::system_clock::now()); },
      SteadyClock steady = [] { return std::chrono::steady_clock::now(); });

  /// Arms both cameras, pulses the projector once, grabs both frames, checks that they belong together, and disarms
  /// on every path. A pair that is incomplete or mismatched is never returned. They belong together when
  /// - each frame whose camera tells the time was exposed while the projector was lit;
  /// - their exposures started within max_skew: on the host's clock where both cameras tell it, else on the cameras'
  ///   own clocks, as time since the pair before, where that is at most two seconds ago;
  /// - their counters advanced by one since the pair before (where both count upwards, and none runs free).
  ///
  /// After idling, and when just opened, the first pairs are thrown away: cameras lose their first frames. While a
  /// picture saturates, shorter exposures are added and merged into one picture of more bits; how many it took is
  /// remembered. With `ambient`, a pair with the projector dark comes along, and the projector must have made the
  /// pictures brighter.
  /// @throws DeviceError (kFrameMissing, kSkewTooLarge, kStrayTrigger, kFrameInvalid, kProjectorDark, and what cameras
  /// and projector
  ///   throw); std::invalid_argument when pulse_width is more than the projector allows
  [[nodiscard]] FramePair CapturePair();
  /// Ends a CapturePair that blocks in another thread. Any thread.
  void Interrupt() noexcept;

  [[nodiscard]] const RigCounters& counters() const { return counters_; }

 private:
  /// A pair as the cameras count and time it.
  struct PairMarks {
    std::array<std::uint64_t, 2> ids{};
    std::array<std::optional<std::chrono::nanoseconds>, 2> device_times;
    std::chrono::steady_clock::time_point taken;
  };
  enum class Light { kLit, kDark };
  /// A pair merged of several exposures.
  struct Bracketed {
    FramePair pair;
    int taken = 0;   ///< shorter exposures in it
    int needed = 0;  ///< so many would have been enough
  };

  static void ConfirmLight(const FramePair& pair);
  void WarmUp();
  [[nodiscard]] Bracketed TakeBrackets(Light light, int least, int most);
  [[nodiscard]] FramePair TakePair(Light light);
  [[nodiscard]] std::optional<LitInterval> FireTrigger(Light light);
  [[nodiscard]] Frame GrabFrame(std::size_t side, const std::optional<LitInterval>& lit);
  void CheckPulse(std::size_t side, const Frame& frame, const LitInterval& lit) const;
  void CheckCounters(const PairMarks& before);
  [[nodiscard]] std::optional<std::chrono::microseconds> SkewOf(const FramePair& pair,
                                                                const std::optional<PairMarks>& before) const;
  [[nodiscard]] bool SetExposures(double divisor);
  [[nodiscard]] std::string PairName() const;

  std::array<std::unique_ptr<Camera>, 2> cameras_;  // left, right
  std::unique_ptr<Projector> projector_;
  CaptureOptions options_;
  UtcClock now_;
  SteadyClock steady_;
  RigCounters counters_;
  std::optional<PairMarks> before_;  ///< the last pair grabbed
  int brackets_ = 0;                 ///< shorter exposures that the last picture needed
};

/// Opens the cameras and the projector that `options` names.
/// Simulated cameras come in pairs and share one scene with a simulated projector; with projector "none" they see
/// ambient light only. A replay camera goes with any real one.
/// @throws DeviceError when a device is absent or refuses its settings; std::invalid_argument for simulated and real
///   devices mixed, and for what SimScene refuses.
[[nodiscard]] Rig OpenRig(const RigOptions& options, const RigWorld& world);

}  // namespace granary
