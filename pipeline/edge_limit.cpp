// Most edges join neighbouring points, so the median edge is the spacing whatever bridges the triangulation built.
#include "pipeline/edge_limit.h"

#include <cmath>
#include <limits>

namespace granary {

namespace {

constexpr double kCellSpacings = 32;
constexpr std::size_t kEnoughEdges = 60;  // for a median of its own

double Median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

LocalSpacing::LocalSpacing(std::span<const Eigen::Vector2d> plan,
                           std::span<const std::array<std::uint32_t, 3>> triangles, double typical_m)
    : cell_m_(kCellSpacings * typical_m), median_m_(typical_m) {
  if (triangles.empty()) return;
  Eigen::Vector2d low = plan[triangles[0][0]], high = low;
  for (const auto& triangle : triangles) {
    const Eigen::Vector2d& corner = plan[triangle[0]];
    low = low.cwiseMin(corner);
    high = high.cwiseMax(corner);
  }
  origin_ = low;
  columns_ = static_cast<int>((high.x() - low.x()) / cell_m_) + 1;
  rows_ = static_cast<int>((high.y() - low.y()) / cell_m_) + 1;
  std::vector<std::vector<double>> edges(static_cast<std::size_t>(columns_) * rows_);
  for (const auto& triangle : triangles) {
    const Eigen::Vector2d &a = plan[triangle[0]], &b = plan[triangle[1]], &c = plan[triangle[2]];
    auto& cell = edges[static_cast<std::size_t>((a.y() - low.y()) / cell_m_) * columns_ +
                       static_cast<std::size_t>((a.x() - low.x()) / cell_m_)];
    for (const double squared : {(a - b).squaredNorm(), (b - c).squaredNorm(), (c - a).squaredNorm()}) {
      cell.push_back(std::sqrt(squared));
    }
  }
  spacing_m_.assign(edges.size(), std::numeric_limits<double>::quiet_NaN());
  std::vector<double> medians, rest;
  for (std::size_t i = 0; i < edges.size(); ++i) {
    if (edges[i].size() < kEnoughEdges) {
      rest.insert(rest.end(), edges[i].begin(), edges[i].end());
      continue;
    }
    spacing_m_[i] = Median(edges[i]);
    medians.push_back(spacing_m_[i]);
  }
  median_m_ = Median(medians.empty() ? rest : medians);
  if (!(median_m_ > 0)) median_m_ = typical_m;  // nothing but duplicates
  for (double& spacing : spacing_m_) {
    if (!(spacing > 0)) spacing = median_m_;
  }
}

double LocalSpacing::At(const Eigen::Vector2d& place) const {
  if (spacing_m_.empty()) return median_m_;
  const int i = std::clamp(static_cast<int>((place.x() - origin_.x()) / cell_m_), 0, columns_ - 1);
  const int j = std::clamp(static_cast<int>((place.y() - origin_.y()) / cell_m_), 0, rows_ - 1);
  return spacing_m_[static_cast<std::size_t>(j) * columns_ + i];
}

}  // namespace granary
