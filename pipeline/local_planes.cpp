// Samples are pooled once into cells of moments, so that a fit costs a few dozen cells however many samples there are.
#include "pipeline/local_planes.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <Eigen/LU>

namespace granary {

LocalPlanes::LocalPlanes(std::span<const Eigen::Vector3d> points, double cell_m) : cell_m_(cell_m) {
  if (!(cell_m > 0)) throw std::invalid_argument("local planes: the cell must be larger than 0");
  if (points.empty()) return;
  Eigen::Vector2d low = points[0].head<2>(), high = low;
  for (const auto& p : points) {
    low = low.cwiseMin(p.head<2>());
    high = high.cwiseMax(p.head<2>());
  }
  origin_ = low;
  columns_ = static_cast<int>((high.x() - low.x()) / cell_m) + 1;
  rows_ = static_cast<int>((high.y() - low.y()) / cell_m) + 1;
  cells_.resize(static_cast<std::size_t>(columns_) * rows_);
  for (const auto& p : points) {
    const int column = std::min(columns_ - 1, static_cast<int>((p.x() - origin_.x()) / cell_m));
    const int row = std::min(rows_ - 1, static_cast<int>((p.y() - origin_.y()) / cell_m));
    const Eigen::Vector2d at = p.head<2>() - Centre(column, row);
    Moments& m = cells_[static_cast<std::size_t>(row) * columns_ + column];
    m.n += 1;
    m.x += at.x();
    m.y += at.y();
    m.z += p.z();
    m.xx += at.x() * at.x();
    m.xy += at.x() * at.y();
    m.yy += at.y() * at.y();
    m.xz += at.x() * p.z();
    m.yz += at.y() * p.z();
    m.low = std::min(m.low, p.z());
    m.high = std::max(m.high, p.z());
  }
}

Eigen::Vector2d LocalPlanes::Centre(int column, int row) const {
  return origin_ + Eigen::Vector2d(column + 0.5, row + 0.5) * cell_m_;
}

std::optional<double> LocalPlanes::HeightAt(const Eigen::Vector2d& place, double max_slope) const {
  return Fit(place, max_slope, std::numeric_limits<int>::max(), [](int, int) { return true; });
}

std::optional<double> LocalPlanes::HeightBeyond(const Eigen::Vector2d& place, const Eigen::Vector2d& towards,
                                                double distance_m, double max_slope) const {
  constexpr int kBeyond = 12;  // cells; what lies further says little of the place
  return Fit(place, max_slope, static_cast<int>(distance_m / cell_m_) + kBeyond,
             [&](int column, int row) { return (Centre(column, row) - place).dot(towards) >= distance_m; });
}

std::optional<Eigen::Vector3d> LocalPlanes::Centroid(int column, int row) const {
  if (column < 0 || row < 0 || column >= columns_ || row >= rows_) return std::nullopt;
  const Moments& m = cells_[static_cast<std::size_t>(row) * columns_ + column];
  if (m.n == 0) return std::nullopt;
  const Eigen::Vector2d centre = Centre(column, row);
  return Eigen::Vector3d(centre.x() + m.x / m.n, centre.y() + m.y / m.n, m.z / m.n);
}

std::optional<Eigen::Vector3d> LocalPlanes::CentroidAt(const Eigen::Vector2d& place) const {
  return Centroid(static_cast<int>(std::floor((place.x() - origin_.x()) / cell_m_)),
                  static_cast<int>(std::floor((place.y() - origin_.y()) / cell_m_)));
}

std::optional<Eigen::Vector3d> LocalPlanes::NearestCentroid(const Eigen::Vector2d& place, int reach) const {
  const int column = static_cast<int>(std::floor((place.x() - origin_.x()) / cell_m_));
  const int row = static_cast<int>(std::floor((place.y() - origin_.y()) / cell_m_));
  std::optional<Eigen::Vector3d> nearest;
  double nearest_m = 0;
  for (int r = 0; r <= reach; ++r) {
    // A cell of the ring r is at least r − 1 cells away.
    if (nearest && nearest_m < (r - 1) * cell_m_) break;
    for (int j = row - r; j <= row + r; ++j) {
      const bool whole_row = std::abs(j - row) == r;
      for (int i = column - r; i <= column + r; i += whole_row || r == 0 ? 1 : 2 * r) {
        const auto centroid = Centroid(i, j);
        if (!centroid) continue;
        const double away_m = (centroid->head<2>() - place).norm();
        if (nearest && away_m >= nearest_m) continue;
        nearest = centroid;
        nearest_m = away_m;
      }
    }
  }
  return nearest;
}

template <typename Use>
std::optional<double> LocalPlanes::Fit(const Eigen::Vector2d& place, double max_slope, int farthest_reach,
                                       Use use) const {
  if (cells_.empty()) return std::nullopt;
  constexpr int kReach = 3;         // cells on each side that a fit looks at, at least
  constexpr int kEnoughCells = 12;  // occupied cells a plane should rest on
  const int column = static_cast<int>(std::floor((place.x() - origin_.x()) / cell_m_));
  const int row = static_cast<int>(std::floor((place.y() - origin_.y()) / cell_m_));
  const int farthest =
      std::min(farthest_reach,
               std::max({std::abs(column), std::abs(row), std::abs(columns_ - column), std::abs(rows_ - row)}) + 1);

  int reach = kReach;
  const auto occupied = [&](int r) {
    int count = 0;
    for (int j = std::max(0, row - r); j <= std::min(rows_ - 1, row + r); ++j) {
      for (int i = std::max(0, column - r); i <= std::min(columns_ - 1, column + r); ++i) {
        count += cells_[static_cast<std::size_t>(j) * columns_ + i].n > 0 && use(i, j);
      }
    }
    return count;
  };
  while (true) {
    const int count = occupied(reach);
    if (count >= kEnoughCells || reach >= farthest) break;
    reach = std::max(reach + 1, reach * 5 / 4);
  }

  // Weighted least squares of z = a + b·dx + c·dy about `place`, in units of cells to keep the matrix well scaled.
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  double weight_sum = 0, low = std::numeric_limits<double>::infinity(), high = -low, nearest = low;
  for (int j = std::max(0, row - reach); j <= std::min(rows_ - 1, row + reach); ++j) {
    for (int i = std::max(0, column - reach); i <= std::min(columns_ - 1, column + reach); ++i) {
      const Moments& m = cells_[static_cast<std::size_t>(j) * columns_ + i];
      if (m.n == 0 || !use(i, j)) continue;
      const Eigen::Vector2d to = (Centre(i, j) - place) / cell_m_;
      const double w = 1.0 / (1.0 + 0.25 * to.squaredNorm());
      const double x = m.x / cell_m_, y = m.y / cell_m_;
      const double sx = x + m.n * to.x(), sy = y + m.n * to.y();
      normal(0, 0) += w * m.n;
      normal(0, 1) += w * sx;
      normal(0, 2) += w * sy;
      normal(1, 1) += w * (m.xx / (cell_m_ * cell_m_) + 2 * x * to.x() + m.n * to.x() * to.x());
      normal(1, 2) += w * (m.xy / (cell_m_ * cell_m_) + x * to.y() + y * to.x() + m.n * to.x() * to.y());
      normal(2, 2) += w * (m.yy / (cell_m_ * cell_m_) + 2 * y * to.y() + m.n * to.y() * to.y());
      right(0) += w * m.z;
      right(1) += w * (m.xz / cell_m_ + m.z * to.x());
      right(2) += w * (m.yz / cell_m_ + m.z * to.y());
      weight_sum += w * m.n;
      low = std::min(low, m.low);
      high = std::max(high, m.high);
      nearest = std::min(nearest, to.norm() * cell_m_);
    }
  }
  if (weight_sum == 0) return std::nullopt;
  const double mean = right(0) / weight_sum;
  normal(1, 0) = normal(0, 1);
  normal(2, 0) = normal(0, 2);
  normal(2, 1) = normal(1, 2);
  // A trace of ridge on the slopes: samples on one line leave the slope across it at 0.
  normal(1, 1) += 1e-6 * normal(0, 0);
  normal(2, 2) += 1e-6 * normal(0, 0);
  const Eigen::Vector3d plane = normal.partialPivLu().solve(right);
  double height = plane(0);
  const double slope = plane.tail<2>().norm() / cell_m_;
  if (!std::isfinite(height)) return mean;
  if (slope > max_slope) {
    // Turn the plane about the centre of the samples until it is just steep enough.
    height = mean + (height - mean) * max_slope / slope;
  }
  const double room = max_slope * nearest;
  return std::clamp(height, low - room, high + room);
}

}  // namespace granary
