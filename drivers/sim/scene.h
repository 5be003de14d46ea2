// The simulated bin: grain of known volume under a dot projector, as two calibrated cameras see it.
#pragma once

#include <cstdint>
#include <memory>

#include <Eigen/Core>
#include <opencv2/core/types.hpp>

#include "drivers/options.h"
#include "drivers/rig.h"
#include "drivers/sim/height_field.h"
#include "drivers/sim/sensor.h"
#include "drivers/sim/shell.h"
#include "pipeline/types/frame.h"

namespace granary {

enum class Side { kLeft, kRight };

/// What a camera sees in one pixel: the first surface on its ray.
struct SeenPoint {
  SceneSurface surface = SceneSurface::kNothing;
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();  ///< metres; meaningless with kNothing
  bool reached_by_projector = false;                         ///< false in the shadow of a wall, pillar or grain
};

/// Deterministic: equal options, world, steps and shots give equal pixels, whatever the number of threads.
/// Owned and used by one thread.
class SimScene {
 public:
  /// @throws std::invalid_argument when the grain does not fit, the rig stands inside something solid or looks away, or
  ///   the calibration cannot be simulated; the sentence names the key and what is allowed.
  SimScene(const SimOptions& options, const RigWorld& world);
  ~SimScene();
  SimScene(SimScene&&) noexcept;
  SimScene& operator=(SimScene&&) noexcept;

  /// One step of SimOptions::motion: time goes by measurements. Nothing happens in an empty bin.
  void Advance();
  /// The integral of the very surface that is rendered, over the footprint less the excluded polygons; 0 when empty.
  [[nodiscard]] double TruthVolume_m3() const;
  /// That surface, world frame.
  [[nodiscard]] const HeightField& Surface() const;
  /// What the bin would hold when full to its height.
  [[nodiscard]] double Capacity_m3() const;

  /// Both cameras' pictures of one shot with default exposure. `shot` selects the noise. Frames have no exposure time.
  /// @param lit false: the projector stays dark
  [[nodiscard]] FramePair Render(std::uint64_t shot, bool lit = true);
  /// One camera's picture.
  [[nodiscard]] Frame RenderSide(Side side, std::uint64_t shot, bool lit, const SimExposure& exposure);

  /// The truth behind a pixel (sub-pixel positions allowed, pixel centres at integers).
  [[nodiscard]] SeenPoint PointSeenBy(Side side, const cv::Point2d& pixel) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace granary
