// Every triangle belongs to all limits from its longest edge upwards: each is added once, to the smallest such limit,
// and the sums over the limits below give the rest.
#include "pipeline/edge_sweep.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>

#include <Eigen/Core>

#include "pipeline/compensated_sum.h"
#include "pipeline/edge_limit.h"
#include "pipeline/volume.h"

namespace granary {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

constexpr std::size_t kLeastLimits = 3;  // two equal volumes may be chance

struct Sums {
  CompensatedSum measured, interpolated, measured_area, interpolated_area;
};

void CheckLimits(std::span<const double> limits_m) {
  for (std::size_t i = 0; i < limits_m.size(); ++i) {
    const std::string which = "edge limit " + std::to_string(i + 1) + " of the sweep is " + std::to_string(limits_m[i]);
    if (!std::isfinite(limits_m[i]) || !(limits_m[i] > 0)) {
      throw std::invalid_argument(which + " m, a length larger than 0 is wanted");
    }
    if (i > 0 && !(limits_m[i] > limits_m[i - 1])) {
      throw std::invalid_argument(which + " m, not larger than the one before");
    }
  }
}

void CheckArrays(const Surface& surface) {
  const std::size_t vertices = surface.vertices_in_world.size();
  if (surface.height_m.size() != vertices || surface.interpolated.size() != vertices) {
    throw std::invalid_argument("edge sweep: " + std::to_string(vertices) + " vertices but " +
                                std::to_string(surface.height_m.size()) + " heights and " +
                                std::to_string(surface.interpolated.size()) + " flags of interpolation");
  }
}

}  // namespace

std::vector<EdgeSweepStep> SweepEdgeLimits(const Surface& surface, std::span<const double> limits_m) {
  CheckLimits(limits_m);
  CheckArrays(surface);
  std::vector<double> squared(limits_m.size());
  std::transform(limits_m.begin(), limits_m.end(), squared.begin(), [](double limit) { return limit * limit; });

  std::vector<Sums> sums(limits_m.size());
  for (const auto* triangles : {&surface.triangles, &surface.too_long}) {
    for (const Triangle& t : *triangles) {
      if (*std::max_element(t.begin(), t.end()) >= surface.vertices_in_world.size()) {
        throw std::invalid_argument("edge sweep: a triangle names a missing vertex");
      }
      const Eigen::Vector2d a = surface.vertices_in_world[t[0]].head<2>(),
                            b = surface.vertices_in_world[t[1]].head<2>(),
                            c = surface.vertices_in_world[t[2]].head<2>();
      const double area = PlanArea_m2(a, b, c);
      const double volume =
          PrismVolume_m3(area, surface.height_m[t[0]], surface.height_m[t[1]], surface.height_m[t[2]]);
      if (!std::isfinite(volume)) throw std::invalid_argument("edge sweep: a triangle has a corner that is not finite");
      const auto first =
          std::lower_bound(squared.begin(), squared.end(), LongestEdgeSquared(a, b, c)) - squared.begin();
      if (first == std::ssize(squared)) continue;
      Sums& sum = sums[static_cast<std::size_t>(first)];
      const bool completed = surface.interpolated[t[0]] || surface.interpolated[t[1]] || surface.interpolated[t[2]];
      (completed ? sum.interpolated : sum.measured).Add(volume);
      (completed ? sum.interpolated_area : sum.measured_area).Add(area);
    }
  }

  std::vector<EdgeSweepStep> steps(limits_m.size());
  Sums below;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    below.measured.Add(sums[i].measured.Value());
    below.interpolated.Add(sums[i].interpolated.Value());
    below.measured_area.Add(sums[i].measured_area.Value());
    below.interpolated_area.Add(sums[i].interpolated_area.Value());
    EdgeSweepStep& step = steps[i];
    step.edge_threshold_m = limits_m[i];
    step.measured_m3 = below.measured.Value();
    step.interpolated_m3 = below.interpolated.Value();
    step.total_m3 = step.measured_m3 + step.interpolated_m3;
    step.measured_area_m2 = below.measured_area.Value();
    step.area_m2 = step.measured_area_m2 + below.interpolated_area.Value();
  }
  return steps;
}

std::optional<Plateau> FindPlateau(std::span<const double> limits_m, std::span<const double> volumes_m3) {
  if (limits_m.size() != volumes_m3.size()) {
    throw std::invalid_argument("plateau: " + std::to_string(limits_m.size()) + " limits but " +
                                std::to_string(volumes_m3.size()) + " volumes");
  }
  for (const double volume : volumes_m3) {
    if (!std::isfinite(volume)) throw std::invalid_argument("plateau: a volume is not finite");
  }
  std::optional<Plateau> best;
  std::size_t best_count = kLeastLimits - 1;
  for (std::size_t first = 0; first < limits_m.size(); ++first) {
    double low = volumes_m3[first], high = low, sum = 0;
    for (std::size_t last = first; last < limits_m.size(); ++last) {
      low = std::min(low, volumes_m3[last]);
      high = std::max(high, volumes_m3[last]);
      sum += volumes_m3[last];
      // Of the larger of the two in size, so that volumes on both sides of 0 are never called equal.
      const double largest = std::max(std::abs(low), std::abs(high));
      const double spread_percent = largest > 0 ? 100 * (high - low) / largest : 0;
      if (spread_percent > kPlateauSpreadPercent) break;
      const std::size_t count = last - first + 1;
      const bool better = count > best_count || (best && count == best_count && spread_percent < best->spread_percent);
      if (largest == 0 || !better) continue;
      best_count = count;
      best = Plateau{limits_m[first], limits_m[last], sum / static_cast<double>(count), spread_percent};
    }
  }
  return best;
}

}  // namespace granary
