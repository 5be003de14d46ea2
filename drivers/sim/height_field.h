// A surface z = h(x, y): what the simulated grain is, for the picture and for the truth alike.
#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "pipeline/types/bin.h"

namespace granary {

/// Node heights on a regular grid, bilinear in between. Node (i, j) is at `origin_m + (i·cell.x, j·cell.y)`.
struct HeightField {
  Eigen::Vector2d origin_m = Eigen::Vector2d::Zero();  ///< world xy of node (0, 0)
  Eigen::Vector2d cell_m = Eigen::Vector2d::Ones();
  int columns = 0, rows = 0;  ///< nodes along x and y, at least 2 each
  std::vector<double> z_m;    ///< rows × columns, row-major; world z

  [[nodiscard]] double Node(int i, int j) const { return z_m[static_cast<std::size_t>(j) * columns + i]; }
};

/// A grid of about `cells` cells along the longer side, its borders on the bounding box of `footprint`; heights are 0.
[[nodiscard]] HeightField GridOver(const Polygon& footprint, int cells);

/// Height of the surface at a world xy, metres; beyond the border that of the nearest border point.
[[nodiscard]] double HeightAt(const HeightField& field, const Eigen::Vector2d& point);

/// One weight a node, m², such that Σ weight·z is exactly the integral of the bilinear surface over the footprint less
/// the excluded polygons. Cells that a polygon cuts count with the part inside.
/// @throws std::invalid_argument when excluded polygons overlap or leave the footprint.
[[nodiscard]] std::vector<double> NodeWeights_m2(const HeightField& grid, const Polygon& footprint,
                                                 const std::vector<Polygon>& exclude);

/// Where a ray meets the surface.
struct SurfaceHit {
  double t = 0;                                     ///< in lengths of the ray's direction
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();  ///< ∂z/∂x, ∂z/∂y there
};

/// Intersects rays with one field: skips with its greatest slopes what is safely above, then solves cell by cell.
/// Borrows the field. Any number of threads.
class SurfaceCaster {
 public:
  explicit SurfaceCaster(const HeightField& field);
  /// The first point in [t_begin, t_end] at which origin + t·direction is on or under the surface, exact to rounding.
  [[nodiscard]] std::optional<SurfaceHit> First(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                                double t_begin, double t_end) const;
  [[nodiscard]] double MaxHeight_m() const { return max_z_m_; }

 private:
  const HeightField* field_;
  double max_z_m_ = 0;
  Eigen::Vector2d max_slope_ = Eigen::Vector2d::Zero();
};

}  // namespace granary
