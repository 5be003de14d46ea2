// The floor that grain heights are counted from: the empty bin's where it was seen, z = 0 where it never was.
#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "pipeline/types/bin.h"

namespace granary {

/// Immutable; may be read from several threads.
class Floor {
 public:
  /// The ideal floor, z = 0.
  Floor() = default;

  /// From points of the empty bin seen by the rigs that watch it. Points off the floor (walls, beams, cables) are told
  /// apart by a robust plane: floor is what lies within `tolerance_m` of it.
  /// @param cell_m side of the pooling cells; finer unevenness than that is averaged
  /// @param margin_m points nearer than this to the footprint's edge are left out: they may be wall
  /// @throws std::invalid_argument when no floor can be found in the points, with the reason
  Floor(std::span<const Eigen::Vector3d> points_in_world, const Bin& bin, double cell_m, double tolerance_m,
        double margin_m);

  /// Height of the floor, m.
  [[nodiscard]] double HeightAt(const Eigen::Vector2d& place) const;
  [[nodiscard]] bool Measured() const { return !nodes_.empty(); }
  /// Share of the grain floor that was seen, 0 … 1.
  [[nodiscard]] double SeenShare() const { return seen_share_; }

 private:
  Eigen::Vector2d origin_{0, 0};
  double cell_m_ = 1;
  int columns_ = 0, rows_ = 0;
  std::vector<double> nodes_;  ///< heights at the corners of cells
  double seen_share_ = 0;
};

/// Distance from `place` to the nearest edge of the footprint or of an excluded polygon, m.
[[nodiscard]] double DistanceToEdge_m(const Bin& bin, const Eigen::Vector2d& place);
/// True where grain can lie: inside the footprint and outside every excluded polygon.
[[nodiscard]] bool IsGrainFloor(const Bin& bin, const Eigen::Vector2d& place);

}  // namespace granary
