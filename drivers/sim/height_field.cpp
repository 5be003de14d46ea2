// Everything here treats a cell as the bilinear patch it is: the integral by a rule that is exact for it, the ray by
// the quadratic it gives. Picture and truth therefore agree to rounding.
#include "drivers/sim/height_field.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace granary {
namespace {

// Keeps the part of the polygon where axis·sign <= bound·sign (Sutherland–Hodgman). For a polygon that is not convex
// the result may have edges that run there and back; signed areas are right all the same.
Polygon ClipHalfPlane(const Polygon& polygon, int axis, double bound, double sign) {
  Polygon kept;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d& a = polygon[i];
    const Eigen::Vector2d& b = polygon[(i + 1) % polygon.size()];
    const double in_a = (bound - a[axis]) * sign, in_b = (bound - b[axis]) * sign;
    if (in_a >= 0) kept.push_back(a);
    if ((in_a > 0 && in_b < 0) || (in_a < 0 && in_b > 0)) {
      Eigen::Vector2d cut = a + (b - a) * (in_a / (in_a - in_b));
      cut[axis] = bound;
      kept.push_back(cut);
    }
  }
  return kept;
}

// Integrals of a cell's four bilinear node functions over `part`, in cell units [0, 1]²; order 00, 10, 01, 11.
std::array<double, 4> IntegrateNodeFunctions(const Polygon& part) {
  std::array<double, 4> sum{};
  for (std::size_t k = 1; k + 1 < part.size(); ++k) {
    const std::array<Eigen::Vector2d, 3> corner{part[0], part[k], part[k + 1]};
    const Eigen::Vector2d ab = corner[1] - corner[0], ac = corner[2] - corner[0];
    const double area = (ab.x() * ac.y() - ab.y() * ac.x()) / 2;
    for (int e = 0; e < 3; ++e) {
      // The mean over the three edge midpoints is exact for quadratics, so for p·q.
      const Eigen::Vector2d m = (corner[e] + corner[(e + 1) % 3]) / 2;
      sum[0] += area / 3 * (1 - m.x()) * (1 - m.y());
      sum[1] += area / 3 * m.x() * (1 - m.y());
      sum[2] += area / 3 * (1 - m.x()) * m.y();
      sum[3] += area / 3 * m.x() * m.y();
    }
  }
  return sum;
}

void AddWeights(const HeightField& grid, const Polygon& polygon, double sign, std::vector<double>& weights) {
  double twice_area = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const auto& a = polygon[i];
    const auto& b = polygon[(i + 1) % polygon.size()];
    twice_area += a.x() * b.y() - b.x() * a.y();
  }
  const double winding = twice_area < 0 ? -1 : 1;
  Polygon in_cells;  // in cell units, where the borders of an aligned rectangle are whole numbers
  for (const auto& p : polygon) {
    Eigen::Vector2d cell = (p - grid.origin_m).cwiseQuotient(grid.cell_m);
    for (int axis = 0; axis < 2; ++axis) {
      if (std::abs(cell[axis] - std::round(cell[axis])) < 1e-9) cell[axis] = std::round(cell[axis]);
    }
    in_cells.push_back(cell);
  }
  const double cell_area = grid.cell_m.prod() * sign;
  for (int j = 0; j + 1 < grid.rows; ++j) {
    for (int i = 0; i + 1 < grid.columns; ++i) {
      const Eigen::Vector2d centre(i + 0.5, j + 0.5);
      std::array<double, 4> share{0.25, 0.25, 0.25, 0.25};
      if (DistanceToBorder_m(in_cells, centre) > std::sqrt(0.5)) {  // half a cell's diagonal, in cells: not cut
        if (!Contains(in_cells, centre)) continue;
      } else {
        Polygon part = ClipHalfPlane(in_cells, 0, i, -1);
        part = ClipHalfPlane(part, 0, i + 1, 1);
        part = ClipHalfPlane(part, 1, j, -1);
        part = ClipHalfPlane(part, 1, j + 1, 1);
        for (auto& p : part) p -= Eigen::Vector2d(i, j);
        share = IntegrateNodeFunctions(part);
        for (double& s : share) s *= winding;
      }
      double* node = &weights[static_cast<std::size_t>(j) * grid.columns + i];
      node[0] += cell_area * share[0];
      node[1] += cell_area * share[1];
      node[grid.columns] += cell_area * share[2];
      node[grid.columns + 1] += cell_area * share[3];
    }
  }
}

}  // namespace

HeightField GridOver(const Polygon& footprint, int cells) {
  if (footprint.size() < 3) throw std::invalid_argument("footprint_m: needs at least 3 corners");
  Eigen::Vector2d low = footprint[0], high = footprint[0];
  for (const auto& p : footprint) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Eigen::Vector2d extent = high - low;
  if (!(extent.minCoeff() > 0)) throw std::invalid_argument("footprint_m: has no area");
  HeightField grid;
  grid.origin_m = low;
  const double cell_m = extent.maxCoeff() / cells;
  grid.columns = 1 + std::max(1, static_cast<int>(std::lround(extent.x() / cell_m)));
  grid.rows = 1 + std::max(1, static_cast<int>(std::lround(extent.y() / cell_m)));
  grid.cell_m = extent.cwiseQuotient(Eigen::Vector2d(grid.columns - 1, grid.rows - 1));
  grid.z_m.assign(static_cast<std::size_t>(grid.columns) * grid.rows, 0.0);
  return grid;
}

double HeightAt(const HeightField& field, const Eigen::Vector2d& point) {
  const Eigen::Vector2d at = (point - field.origin_m).cwiseQuotient(field.cell_m);
  const double u = std::clamp(at.x(), 0.0, field.columns - 1.0), v = std::clamp(at.y(), 0.0, field.rows - 1.0);
  const int i = std::min(static_cast<int>(u), field.columns - 2), j = std::min(static_cast<int>(v), field.rows - 2);
  const double p = u - i, q = v - j;
  return (1 - q) * ((1 - p) * field.Node(i, j) + p * field.Node(i + 1, j)) +
         q * ((1 - p) * field.Node(i, j + 1) + p * field.Node(i + 1, j + 1));
}

std::vector<double> NodeWeights_m2(const HeightField& grid, const Polygon& footprint,
                                   const std::vector<Polygon>& exclude) {
  std::vector<double> weights(grid.z_m.size(), 0.0);
  AddWeights(grid, footprint, 1, weights);
  for (std::size_t k = 0; k < exclude.size(); ++k) {
    AddWeights(grid, exclude[k], -1, weights);
    // A floor that is taken away twice, or was never there, leaves a node in debt.
    const double least = *std::min_element(weights.begin(), weights.end());
    if (least < -1e-6 * grid.cell_m.prod()) {
      throw std::invalid_argument("exclude_m[" + std::to_string(k) +
                                  "]: must lie inside the footprint and apart from the other excluded polygons");
    }
  }
  return weights;
}

SurfaceCaster::SurfaceCaster(const HeightField& field) : field_(&field) {
  max_z_m_ = *std::max_element(field.z_m.begin(), field.z_m.end());
  Eigen::Vector2d step = Eigen::Vector2d::Zero();
  for (int j = 0; j < field.rows; ++j) {
    for (int i = 0; i < field.columns; ++i) {
      if (i > 0) step.x() = std::max(step.x(), std::abs(field.Node(i, j) - field.Node(i - 1, j)));
      if (j > 0) step.y() = std::max(step.y(), std::abs(field.Node(i, j) - field.Node(i, j - 1)));
    }
  }
  max_slope_ = step.cwiseQuotient(field.cell_m);
}

std::optional<SurfaceHit> SurfaceCaster::First(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                               double t_begin, double t_end) const {
  const HeightField& f = *field_;
  if (!(t_begin <= t_end)) return std::nullopt;
  // In cell units across, metres up.
  const double u0 = (origin.x() - f.origin_m.x()) / f.cell_m.x(), du = direction.x() / f.cell_m.x();
  const double v0 = (origin.y() - f.origin_m.y()) / f.cell_m.y(), dv = direction.y() / f.cell_m.y();
  const double dz = direction.z();
  const double last_u = f.columns - 1.0, last_v = f.rows - 1.0;

  // The gap to the surface closes no faster than this, so gap / closing is a step that cannot pass through it.
  const double closing = -dz + max_slope_.x() * std::abs(direction.x()) + max_slope_.y() * std::abs(direction.y());
  if (closing <= 0) {
    if (t_begin > 0 || origin.z() > HeightAt(f, origin.head<2>())) return std::nullopt;  // rises faster than any slope
  }
  const double cells_a_t = std::abs(du) + std::abs(dv);
  double t = t_begin;
  for (int step = 0; closing > 0 && step < 64; ++step) {
    const double u = std::clamp(u0 + t * du, 0.0, last_u), v = std::clamp(v0 + t * dv, 0.0, last_v);
    const int i = std::min(static_cast<int>(u), f.columns - 2), j = std::min(static_cast<int>(v), f.rows - 2);
    const double p = u - i, q = v - j;
    const double* node = &f.z_m[static_cast<std::size_t>(j) * f.columns + i];
    const double below = node[0] + p * (node[1] - node[0]);
    const double above = node[f.columns] + p * (node[f.columns + 1] - node[f.columns]);
    const double gap = origin.z() + t * dz - (below + q * (above - below));
    const double safe = gap / closing;
    if (!(safe > 0)) break;
    if (safe * cells_a_t < 0.5) break;  // near enough to walk
    t += safe;
    if (t > t_end) return std::nullopt;
  }

  int i = std::clamp(static_cast<int>(std::floor(u0 + t * du)), 0, f.columns - 2);
  int j = std::clamp(static_cast<int>(std::floor(v0 + t * dv)), 0, f.rows - 2);
  for (;;) {
    const double p = std::clamp(u0 + t * du - i, 0.0, 1.0), q = std::clamp(v0 + t * dv - j, 0.0, 1.0);
    const double exit_u = du > 0 ? (1 - p) / du : du < 0 ? -p / du : std::numeric_limits<double>::infinity();
    const double exit_v = dv > 0 ? (1 - q) / dv : dv < 0 ? -q / dv : std::numeric_limits<double>::infinity();
    const double exit = std::min({exit_u, exit_v, t_end - t});

    const double* node = &f.z_m[static_cast<std::size_t>(j) * f.columns + i];
    const double h00 = node[0], h10 = node[1], h01 = node[f.columns], h11 = node[f.columns + 1];
    const double hp = h10 - h00, hq = h01 - h00, hpq = h11 - h10 - h01 + h00;
    // Height over the patch after τ more: a τ² + b τ + c.
    const double c = origin.z() + t * dz - (h00 + hp * p + hq * q + hpq * p * q);
    const double b = dz - (hp * du + hq * dv + hpq * (p * dv + q * du));
    const double a = -hpq * du * dv;
    double root = std::numeric_limits<double>::infinity();
    if (c <= 0) {
      root = 0;
    } else if (const double discriminant = b * b - 4 * a * c; discriminant >= 0) {
      const double s = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
      if (s != 0) {
        const double first = c / s;
        if (first >= 0) root = first;
        if (a != 0 && s / a >= 0) root = std::min(root, s / a);
      }
    }
    if (root <= exit) {
      const double hit_p = p + root * du, hit_q = q + root * dv;
      return SurfaceHit{t + root, {(hp + hpq * hit_q) / f.cell_m.x(), (hq + hpq * hit_p) / f.cell_m.y()}};
    }
    t += std::max(exit, 0.0);
    if (t >= t_end) return std::nullopt;
    if (exit_u <= exit_v) {
      i += du > 0 ? 1 : -1;
    } else {
      j += dv > 0 ? 1 : -1;
    }
    if (i < 0 || j < 0 || i > f.columns - 2 || j > f.rows - 2) return std::nullopt;
  }
}

}  // namespace granary
