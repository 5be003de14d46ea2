// The nearest point is never looked for: it is enough to know whether any point is near. Neighbours in the picture are
// neighbours in space, so the cells around a point and the last near point found usually serve the next one too.
#include "pipeline/segment.h"

#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "pipeline/cell_grid.h"
#include "pipeline/large_pages.h"

namespace granary {
namespace {

/// The filled cells around one cell. The rows of a picture pass through the same cells again and again.
struct Neighbourhood {
  CellGrid::Cell centre;
  bool known = false;
  std::vector<std::uint32_t> numbers;
};
constexpr std::size_t kRecent = 2048;  // remembered at a time, a power of two

}  // namespace

std::vector<std::uint8_t> FindScenePoints(std::span<const Eigen::Vector3f> points,
                                          std::span<const Eigen::Vector3f> empty_bin, double distance_m) {
  if (!(distance_m >= 0) || !std::isfinite(distance_m)) {
    throw std::invalid_argument("FindScenePoints: the distance must be finite and 0 m or more");
  }
  constexpr std::size_t kMost = std::numeric_limits<std::uint32_t>::max();
  if (points.size() >= kMost || empty_bin.size() >= kMost) {
    throw std::invalid_argument("FindScenePoints: more points than 32 bits can count");
  }
  const CellGrid grid(empty_bin, distance_m);
  auto scene = MakeLarge<std::uint8_t>(points.size());
  const auto decide = [&](const tbb::blocked_range<std::size_t>& range) {
    std::vector<Neighbourhood> recent(kRecent);
    const Eigen::Vector3f* near = nullptr;
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      if (!points[i].allFinite()) continue;
      const Eigen::Array3d p = points[i].array().cast<double>();
      if (near != nullptr && grid.IsWithin(p, *near)) {
        scene[i] = 1;
        continue;
      }
      const CellGrid::Cell cell = grid.CellOf(points[i]);
      Neighbourhood& around = recent[cell.Hash() % kRecent];
      if (!around.known || !(around.centre == cell)) {
        around.centre = cell;
        around.known = true;
        grid.FindNeighbours(cell, around.numbers);
      }
      const Eigen::Vector3f* found = grid.FindWithin(p, around.numbers);
      if (found == nullptr) continue;
      near = found;
      scene[i] = 1;
    }
  };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), 32'768), decide);
  return scene;
}

}  // namespace granary
