// The share depends on the measured height alone, so that the volume is linear in the offset and one fill finds it.
#include "pipeline/relief.h"

#include <algorithm>
#include <cmath>

#include "pipeline/volume.h"

namespace granary {

namespace {

constexpr double kKernel_m = 0.003;  // thickness of a kernel of wheat
// Without an offset: half the span between the kernels' envelope and a sheet laid over them, for wheat.
constexpr double kUnknownRelief_m = 5e-4;
constexpr double kUnstatedShare = 0.25;  // deviation of an offset that was given without its uncertainty

}  // namespace

double ReliefShare(double height_m) { return std::clamp(height_m / kKernel_m, 0.0, 1.0); }

double ReliefArea_m2(const Surface& surface) {
  double area_m2 = 0;
  for (const auto& t : surface.triangles) {
    const double share = (ReliefShare(surface.height_m[t[0]]) + ReliefShare(surface.height_m[t[1]]) +
                          ReliefShare(surface.height_m[t[2]])) /
                         3;
    const auto place = [&](int corner) { return surface.vertices_in_world[t[corner]].head<2>(); };
    area_m2 += share * PlanArea_m2(place(0), place(1), place(2));
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
