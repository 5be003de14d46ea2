// A height at any place of the floor plane from scattered heights: the plane that fits the neighbourhood.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace granary {

/// Immutable after construction; may be read from several threads.
class LocalPlanes {
 public:
  /// @param points_in_world samples, metres; z is the height fitted
  /// @param cell_m side of the square cells in which samples are pooled; the fit reaches over a few cells
  LocalPlanes(std::span<const Eigen::Vector3d> points_in_world, double cell_m);

  /// Height at `place`: a plane through the samples nearby, nearer ones weighing more, looking further out until
  /// enough were found; never steeper than `max_slope`, and never outside the heights it was fitted to by more than
  /// that slope allows. Empty when there is no sample at all.
  [[nodiscard]] std::optional<double> HeightAt(const Eigen::Vector2d& place, double max_slope) const;

  /// The same from samples in the half plane that lies `distance_m` or more from `place` in the direction `towards`
  /// (unit vector) alone: what HeightAt would say if nothing nearer had been seen.
  [[nodiscard]] std::optional<double> HeightBeyond(const Eigen::Vector2d& place, const Eigen::Vector2d& towards,
                                                   double distance_m, double max_slope) const;

  /// Mean of the samples pooled in the cell at `place`; empty when there is none.
  [[nodiscard]] std::optional<Eigen::Vector3d> CentroidAt(const Eigen::Vector2d& place) const;
  /// Of the cells with samples the mean of the one nearest to `place`, looking at most `reach` cells away.
  [[nodiscard]] std::optional<Eigen::Vector3d> NearestCentroid(const Eigen::Vector2d& place, int reach) const;
  [[nodiscard]] double cell_m() const { return cell_m_; }

 private:
  struct Moments {
    double n = 0, x = 0, y = 0, z = 0, xx = 0, xy = 0, yy = 0, xz = 0, yz = 0;  // about the cell's centre
    double low = 1e300, high = -1e300;
  };
  [[nodiscard]] Eigen::Vector2d Centre(int column, int row) const;
  [[nodiscard]] std::optional<Eigen::Vector3d> Centroid(int column, int row) const;
  /// HeightAt from the cells that `use(column, row)` allows, at most `farthest_reach` cells away.
  template <typename Use>
  [[nodiscard]] std::optional<double> Fit(const Eigen::Vector2d& place, double max_slope, int farthest_reach,
                                          Use use) const;

  Eigen::Vector2d origin_{0, 0};
  double cell_m_ = 1;
  int columns_ = 0, rows_ = 0;
  std::vector<Moments> cells_;
};

}  // namespace granary
