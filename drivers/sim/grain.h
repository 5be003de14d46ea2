// The grain in the simulated bin: one of the paper's shapes, of exactly the volume asked for.
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/options.h"
#include "drivers/sim/height_field.h"
#include "pipeline/types/bin.h"

namespace granary {

/// The form of the heap, from which a surface of any volume can be made. Immutable; any number of threads.
class Grain {
 public:
  /// Steepest slope of a form, as a tangent; wheat rests at about 28° (tangent 0.53). Bumps ride on top of it.
  static constexpr double kSteepest = 0.52;

  /// @throws std::invalid_argument for a bin without area, height or with excluded polygons that overlap.
  Grain(const Bin& bin, SimShape shape, std::uint64_t seed);

  /// The surface whose integral over the footprint less the excluded polygons is `volume_m3` to 1e-12 relative. Heights
  /// are within [0, bin height]; a form too tall for the volume is flattened, but for kPartial, which leaves floor
  /// bare.
  /// @throws std::invalid_argument when it does not fit into the bin, or is negative or not a number.
  [[nodiscard]] HeightField SurfaceOf(double volume_m3) const;

  /// Integral of a surface made by SurfaceOf, m³: exactly what a ray meets.
  [[nodiscard]] double Volume_m3(const HeightField& surface) const;
  /// What the bin holds when full to its height everywhere, m³.
  [[nodiscard]] double Capacity_m3() const { return floor_m2_ * height_m_; }

 private:
  int bin_id_;
  double height_m_;
  double floor_m2_ = 0;
  bool partial_;
  HeightField grid_;                ///< heights unused
  std::vector<double> weights_m2_;  ///< one a node
  std::vector<double> form_m_;      ///< the smooth shape, mean 0 over the floor
  std::vector<double> bumps_m_;     ///< the roughness, mean 0 over the floor
};

}  // namespace granary
