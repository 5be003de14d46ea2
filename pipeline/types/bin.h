// The bin as the configuration describes it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace granary {

/// Corners in order (either winding), world xy, metres; the last joins the first.
using Polygon = std::vector<Eigen::Vector2d>;

/// What lies in the bin. An absent value is unknown.
struct GrainKind {
  std::string name;
  /// A matcher sees the tops of kernels more than the gaps between them: its surface lies this much above the height
  /// whose integral is the volume. Found from one fill of known volume (granaryctl grain-offset).
  std::optional<double> surface_offset_m;
  std::optional<double> surface_offset_u95_m;  ///< its expanded uncertainty; empty: half the offset
  std::optional<double> angle_of_repose_deg;   ///< no completed surface is steeper
};

/// Geometry of one bin in the world frame.
struct Bin {
  int id = 1;  ///< also the Modbus unit id, 1…247
  std::string name;
  Polygon footprint_m;
  double height_m = 0;             ///< top of the bin above z = 0
  std::vector<Polygon> exclude_m;  ///< floor that holds no grain (pillars, ducts)
  GrainKind grain;
};

/// Book data of one bin (METHOD §7). An absent value is unknown, never 0.
struct Inventory {
  std::optional<double> book_mass_kg;
  std::optional<double> density_kg_m3;
  double correction = 1.0;                    ///< factor on the density: packing, moisture
  double loss_kg = 0.0;                       ///< storage loss, added back to the quantity
  double alarm_percent = 3.0;                 ///< |error rate| beyond this is abnormal
  std::optional<double> density_u95_percent;  ///< expanded uncertainty (k = 2) of density · correction
};

/// Area of a polygon, m² (shoelace; positive whatever the winding).
[[nodiscard]] double Area_m2(const Polygon& polygon);
/// The smallest upright rectangle around a polygon.
[[nodiscard]] Eigen::AlignedBox2d Bounds(const Polygon& polygon);
/// Distance from `point` to the nearest edge of the polygon, m; inside or outside.
[[nodiscard]] double DistanceToBorder_m(const Polygon& polygon, const Eigen::Vector2d& point);
/// Area of the footprint less the excluded polygons inside it, m².
[[nodiscard]] double GrainFloor_m2(const Bin& bin);
/// Volume of the bin up to its height, m³.
[[nodiscard]] double Capacity_m3(const Bin& bin);
/// True when `point` lies inside or on the polygon.
[[nodiscard]] bool Contains(const Polygon& polygon, const Eigen::Vector2d& point);

}  // namespace granary
