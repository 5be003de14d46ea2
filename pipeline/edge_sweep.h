// The paper's study of the edge limit: the volume at many limits from one surface.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "pipeline/surface.h"

namespace granary {

/// What lies under the triangles that one fixed edge limit leaves.
struct EdgeSweepStep {
  double edge_threshold_m = 0;
  double total_m3 = 0;         ///< measured + interpolated
  double measured_m3 = 0;      ///< under triangles of measured points only
  double interpolated_m3 = 0;  ///< under triangles with a completed point
  double area_m2 = 0;          ///< floor area under all triangles left
  double measured_area_m2 = 0;
};

/// The volume for each of `limits_m` in one pass over all triangles of the grain floor, those within the surface's own
/// limit and those beyond it: what BuildSurface with that `edge_threshold_m` and IntegrateVolume give, but for
/// rounding. An empty surface gives zeros.
/// @param limits_m longest edges allowed as seen from above, metres, each larger than the one before
/// @throws std::invalid_argument when a limit is not larger than 0, not finite or not ascending, or when the surface's
///   arrays do not fit together or hold what is not finite
/// Source: Zhao 2023, §6.1 and Figures 17–20.
[[nodiscard]] std::vector<EdgeSweepStep> SweepEdgeLimits(const Surface& surface, std::span<const double> limits_m);

/// Volumes this near to each other count as one, percent peak to peak.
inline constexpr double kPlateauSpreadPercent = 0.1;

/// A range of limits over which the volume does not depend on the limit.
struct Plateau {
  double from_m = 0, to_m = 0;  ///< first and last limit
  double volume_m3 = 0;         ///< mean over the limits
  double spread_percent = 0;    ///< peak to peak, of the largest volume in it
};

/// The longest run of consecutive limits, at least 3, whose volumes differ by no more than kPlateauSpreadPercent of the
/// largest of them; of several as long the flattest. Where no triangle is short enough all volumes are 0; that is no
/// plateau.
/// @return empty when no run qualifies
/// @throws std::invalid_argument when the arrays differ in length or a volume is not finite
[[nodiscard]] std::optional<Plateau> FindPlateau(std::span<const double> limits_m, std::span<const double> volumes_m3);

}  // namespace granary
