// Slopes are those of planes over a patch: of the heap, not of its kernels.
#include "pipeline/surface_samples.h"

#include <algorithm>

#include "pipeline/local_planes.h"

namespace granary {

namespace {

constexpr int kAlong = 20;    // patches along each side of the rectangle around the floor
constexpr int kFinest = 320;  // where the floor is a narrow part of it
constexpr std::size_t kFewest = 30;
constexpr std::size_t kEnough = 50'000;  // vertices that planes over patches need

}  // namespace

std::vector<SurfaceSample> SampleSurface(const Surface& surface, const Floor& floor, const Bin& bin) {
  std::vector<SurfaceSample> samples;
  if (surface.Empty()) return samples;
  const Eigen::AlignedBox2d box = Bounds(bin.footprint_m);
  const double step_m = box.sizes().maxCoeff() / kAlong;
  std::vector<Eigen::Vector3d> some;
  const std::size_t every = std::max<std::size_t>(1, surface.vertices_in_world.size() / kEnough);
  for (std::size_t i = 0; i < surface.vertices_in_world.size(); i += every) {
    some.push_back(surface.vertices_in_world[i]);
  }
  const LocalPlanes planes(some, step_m / 4);
  constexpr double kAnySlope = 10;
  const auto slope = [&](auto height_at, const Eigen::Vector2d& place) -> Eigen::Vector2d {
    const Eigen::Vector2d dx(step_m / 2, 0), dy(0, step_m / 2);
    return Eigen::Vector2d(height_at(place + dx) - height_at(place - dx),
                           height_at(place + dy) - height_at(place - dy)) /
           step_m;
  };
  for (int along = kAlong; samples.size() < kFewest && along <= kFinest; along *= 2) {
    samples.clear();
    for (int row = 0; row < along; ++row) {
      for (int column = 0; column < along; ++column) {
        const Eigen::Vector2d place =
            box.min() + box.sizes().cwiseProduct(Eigen::Vector2d(column + 0.5, row + 0.5) / along);
        if (!IsGrainFloor(bin, place)) continue;
        const auto grain_at = [&](const Eigen::Vector2d& p) { return planes.HeightAt(p, kAnySlope).value(); };
        const auto floor_at = [&](const Eigen::Vector2d& p) { return floor.HeightAt(p); };
        SurfaceSample& sample = samples.emplace_back();
        sample.grain_in_world << place, grain_at(place);
        sample.grain_slope = slope(grain_at, place);
        sample.floor_z_m = floor_at(place);
        sample.floor_slope = slope(floor_at, place);
      }
    }
  }
  const double area_m2 = GrainFloor_m2(bin) / static_cast<double>(samples.size());
  for (SurfaceSample& sample : samples) sample.area_m2 = area_m2;
  return samples;
}

}  // namespace granary
