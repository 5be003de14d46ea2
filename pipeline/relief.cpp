// The share depends on the measured height alone, so that the volume is linear in the offset and one fill finds it.
#include "pipeline/relief.h"

#include <algorithm>
#include <cmath>

namespace granary {

namespace {

constexpr double kKernel_m = 0.003;  // thickness of a kernel of wheat
// Without an offset: half the span between the kernels' envelope and a sheet laid over them, for wheat.
constexpr double kUnknownRelief_m = 5e-4;
constexpr double kUnstatedShare = 0.25;  // deviation of an offset that was given without its uncertainty

double Area_m2(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  return ((b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x())) / 2;
}

}  // namespace

double ReliefShare(double height_m) { return std::clamp(height_m / kKernel_m, 0.0, 1.0); }

double ReliefArea_m2(const Surface& surface) {
  double area_m2 = 0;
  for (const auto& t : surface.triangles) {
    const double share = (ReliefShare(surface.height_m[t[0]]) + ReliefShare(surface.height_m[t[1]]) +
                          ReliefShare(surface.height_m[t[2]])) /
                         3;
    area_m2 += share * Area_m2(surface.vertices_in_world[t[0]], surface.vertices_in_world[t[1]],
                               surface.vertices_in_world[t[2]]);
  }
  return area_m2;
}

void TakeReliefOff(double offset_m, Surface& surface) {
  for (std::size_t i = 0; i < surface.height_m.size(); ++i) {
    const double off_m = offset_m * ReliefShare(surface.height_m[i]);
    surface.height_m[i] -= off_m;
    surface.vertices_in_world[i].z() -= off_m;
  }
}

double ReliefDeviation_m(const GrainKind& grain, bool simulated) {
  if (grain.surface_offset_u95_m) return *grain.surface_offset_u95_m / 2;
  if (grain.surface_offset_m) return kUnstatedShare * std::abs(*grain.surface_offset_m);
  return simulated ? 0 : kUnknownRelief_m;
}

}  // namespace granary
