// Heights are made up by local planes; their error is found by making up what was measured.
#include "pipeline/completion.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "pipeline/floor.h"

namespace granary {

namespace {

constexpr double kSteepest = 1.0;        // 45°: steeper than any grain lies
constexpr std::size_t kMirrored = 2000;  // places looked at, spread evenly
constexpr int kEnoughMirrored = 50;      // fewer say nothing
constexpr double kBlockCells = 8;        // differences within a block of this side go together
constexpr int kFarthestSeam = 40;        // cells

// Which cells of a square grid hold a measured point.
class Occupancy {
 public:
  Occupancy(std::span<const Eigen::Vector3d> points, const Bin& bin, double cell_m) : cell_m_(cell_m) {
    const Eigen::AlignedBox2d box = Bounds(bin.footprint_m);
    low_ = box.min();
    columns_ = static_cast<int>(std::ceil(box.sizes().x() / cell_m)) + 1;
    rows_ = static_cast<int>(std::ceil(box.sizes().y() / cell_m)) + 1;
    cells_.assign(static_cast<std::size_t>(columns_) * rows_, 0);
    for (const auto& p : points) {
      const int i = static_cast<int>((p.x() - low_.x()) / cell_m), j = static_cast<int>((p.y() - low_.y()) / cell_m);
      if (i >= 0 && i < columns_ && j >= 0 && j < rows_) cells_[static_cast<std::size_t>(j) * columns_ + i] = 1;
    }
  }
  /// True when the 3×3 cells around (column, row) are empty.
  [[nodiscard]] bool EmptyAround(int column, int row) const {
    for (int j = std::max(0, row - 1); j <= std::min(rows_ - 1, row + 1); ++j) {
      for (int i = std::max(0, column - 1); i <= std::min(columns_ - 1, column + 1); ++i) {
        if (cells_[static_cast<std::size_t>(j) * columns_ + i]) return false;
      }
    }
    return true;
  }
  [[nodiscard]] Eigen::Vector2d Centre(int column, int row) const {
    return low_ + Eigen::Vector2d(column + 0.5, row + 0.5) * cell_m_;
  }
  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }

 private:
  double cell_m_;
  Eigen::Vector2d low_;
  int columns_ = 0, rows_ = 0;
  std::vector<char> cells_;
};

void AppendEdge(const Polygon& polygon, double step_m, std::vector<Eigen::Vector2d>& places) {
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d a = polygon[i], b = polygon[(i + 1) % polygon.size()];
    const int steps = std::max(1, static_cast<int>(std::ceil((b - a).norm() / step_m)));
    for (int k = 0; k < steps; ++k) places.push_back(a + (b - a) * (static_cast<double>(k) / steps));
  }
}

}  // namespace

std::vector<Eigen::Vector2d> PlacesToComplete(std::span<const Eigen::Vector3d> measured, const Bin& bin,
                                              double step_m) {
  std::vector<Eigen::Vector2d> places;
  AppendEdge(bin.footprint_m, step_m, places);
  for (const auto& hole : bin.exclude_m) AppendEdge(hole, step_m, places);
  // Looked at in half steps, so that the seam to the measured points stays narrower than two steps.
  const Occupancy occupancy(measured, bin, step_m / 2);
  for (int j = 0; j < occupancy.rows(); j += 2) {
    for (int i = 0; i < occupancy.columns(); i += 2) {
      if (!occupancy.EmptyAround(i, j)) continue;
      const Eigen::Vector2d place = occupancy.Centre(i, j);
      // Not within half a step of an edge, which has vertices of its own.
      if (IsGrainFloor(bin, place) && DistanceToEdge_m(bin, place) > step_m / 2) places.push_back(place);
    }
  }
  return places;
}

double SteepestSlope(const Bin& bin) {
  if (!bin.grain.angle_of_repose_deg) return kSteepest;
  return std::tan(*bin.grain.angle_of_repose_deg * std::numbers::pi / 180);
}

std::optional<double> CompletionDeviation_m(const LocalPlanes& planes, std::span<const Eigen::Vector2d> places,
                                            double max_slope) {
  struct Block {
    double sum = 0;
    int count = 0;
  };
  std::map<std::pair<int, int>, Block> blocks;
  int count = 0;
  double sum = 0;
  const std::size_t step = std::max<std::size_t>(1, places.size() / kMirrored);
  for (std::size_t i = 0; i < places.size(); i += step) {
    const auto nearest = planes.NearestCentroid(places[i], kFarthestSeam);
    if (!nearest) continue;
    const Eigen::Vector2d to = nearest->head<2>() - places[i];
    const double distance_m = std::max(to.norm(), planes.cell_m());
    const Eigen::Vector2d inward = to.normalized();
    if (!inward.allFinite()) continue;
    // The seam runs half a cell this side of the nearest centroid.
    const auto mirrored = planes.CentroidAt(places[i] + (2 * distance_m - planes.cell_m() / 2) * inward);
    if (!mirrored) continue;
    const auto predicted = planes.HeightBeyond(mirrored->head<2>(), inward, distance_m, max_slope);
    if (!predicted) continue;
    const double off_m = *predicted - mirrored->z();
    const Eigen::Vector2d at = mirrored->head<2>() / (kBlockCells * planes.cell_m());
    Block& block = blocks[{static_cast<int>(std::floor(at.x())), static_cast<int>(std::floor(at.y()))}];
    block.sum += off_m;
    ++block.count;
    sum += off_m;
    ++count;
  }
  if (count < kEnoughMirrored || blocks.size() < 4) return std::nullopt;
  const double mean = sum / count;
  // Blocks stand for themselves, the places in one do not: the variance of a weighted mean of blocks.
  double variance = 0;
  for (const auto& [where, block] : blocks) {
    const double weight = static_cast<double>(block.count) / count;
    const double off_m = block.sum / block.count - mean;
    variance += weight * weight * off_m * off_m;
  }
  return std::sqrt(mean * mean + variance);
}

}  // namespace granary
