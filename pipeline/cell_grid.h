// A cloud sorted into cubes, to answer "is there a point within this distance?" for many points quickly.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace granary {

/// An axis-parallel box; distances to it bound those to the points it holds.
///
/// Rounding is monotone, and distances to points are computed by the same steps: a point in the box is never computed
/// to be nearer than NearestSquared or further than FurthestSquared. No safety margin is needed.
struct Box {
  Eigen::Array3f low, high;

  [[nodiscard]] double NearestSquared(const Eigen::Array3d& p) const {
    const Eigen::Array3d gap = (low.cast<double>() - p).max(p - high.cast<double>()).max(0.0);
    return gap.x() * gap.x() + gap.y() * gap.y() + gap.z() * gap.z();
  }
  [[nodiscard]] double FurthestSquared(const Eigen::Array3d& p) const {
    const Eigen::Array3d reach = (p - low.cast<double>()).max(high.cast<double>() - p);
    return reach.x() * reach.x() + reach.y() * reach.y() + reach.z() * reach.z();
  }
};

/// Immutable after construction.
class CellGrid {
 public:
  static constexpr std::size_t kBlock = 16;  ///< points that share a box
  struct Cell {
    std::int32_t x = 0, y = 0, z = 0;
    [[nodiscard]] bool operator==(const Cell& other) const {
      return ((x ^ other.x) | (y ^ other.y) | (z ^ other.z)) == 0;  // one branch
    }
    [[nodiscard]] std::size_t Hash() const;
  };

  /// @param points metres; those that are not finite are left out
  /// @param distance_m the largest distance that will be asked for; a cell's side is no less, and more where the points
  ///   lie further apart than that
  CellGrid(std::span<const Eigen::Vector3f> points, double distance_m);

  [[nodiscard]] Cell CellOf(const Eigen::Vector3f& point) const;

  /// Numbers of the filled cells among `centre` and its 26 neighbours: every point within the distance of a point in
  /// `centre` is in one of them. Nearest cells first.
  void FindNeighbours(const Cell& centre, std::vector<std::uint32_t>& numbers) const;

  /// One point of the cells `numbers` that is within the distance of p, or null.
  [[nodiscard]] const Eigen::Vector3f* FindWithin(const Eigen::Array3d& p,
                                                  std::span<const std::uint32_t> numbers) const;

  /// The very comparison that brute force makes.
  [[nodiscard]] bool IsWithin(const Eigen::Array3d& p, const Eigen::Vector3f& q) const {
    const Eigen::Array3d gap = p - q.array().cast<double>();
    return gap.x() * gap.x() + gap.y() * gap.y() + gap.z() * gap.z() <= distance_squared_;
  }

 private:
  [[nodiscard]] std::uint32_t NumberOf(const Cell& cell) const;
  std::uint32_t Enter(const Cell& cell);
  void GrowTable();
  [[nodiscard]] std::uint32_t SubCellOf(const Eigen::Vector3f& point, const Cell& cell) const;
  void OrderCell(std::size_t cell);
  void MakeBoxes();

  double distance_squared_;
  double cells_per_m_;
  std::vector<std::uint32_t> table_;        ///< open addressing: cell numbers, kNone where free
  std::vector<Cell> cells_;                 ///< by number
  std::vector<std::uint32_t> cell_start_;   ///< first point of each cell, and the end
  std::vector<std::uint32_t> block_start_;  ///< first block of each cell
  std::vector<Eigen::Vector3f> points_;     ///< cell by cell
  std::vector<Box> cell_box_, block_box_;
};

inline std::size_t CellGrid::Cell::Hash() const {
  std::uint64_t h = static_cast<std::uint32_t>(x) * 0x9E3779B97F4A7C15ULL;
  h = (h ^ (h >> 29) ^ static_cast<std::uint32_t>(y)) * 0xBF58476D1CE4E5B9ULL;
  h = (h ^ (h >> 32) ^ static_cast<std::uint32_t>(z)) * 0x94D049BB133111EBULL;
  return h ^ (h >> 31);
}

inline CellGrid::Cell CellGrid::CellOf(const Eigen::Vector3f& point) const {
  constexpr double kFurthestCell = 1 << 30;  // cells beyond are one; neighbours stay neighbours when clamped
  const auto along = [&](float coordinate) {
    const double position = std::clamp(static_cast<double>(coordinate) * cells_per_m_, -kFurthestCell, kFurthestCell);
    const auto whole = static_cast<std::int32_t>(position);
    return whole - (position < whole ? 1 : 0);  // std::floor without the call
  };
  return {along(point.x()), along(point.y()), along(point.z())};
}

}  // namespace granary
