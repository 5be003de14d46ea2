// Points are inserted one by one: walk from the last triangle to the one that holds the point, split it, and flip
// edges round the point until every circumcircle is empty. The order makes this fast: along a Hilbert curve a walk is a
// step or two long and what it touches is in the cache, and a sparse sample first (every 8th of every 8th …) gives
// later points a scaffold, without which the rim of the half-done hull would grow long slivers.
//
// The outside is covered by ghost triangles that join each hull edge to a vertex at infinity, so that inserting outside
// the hull is no special case. A half-edge is 4 · triangle + corner; it runs from that corner to the next.
#include "pipeline/delaunay.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "pipeline/hilbert.h"
#include "pipeline/large_pages.h"
#include "pipeline/predicates.h"

namespace granary {
namespace {

using Index = std::uint32_t;
using Triangle = std::array<Index, 3>;

constexpr double kLargest = 1e60;    // beyond, a product of four coordinates and its errors leaves double's range
constexpr double kSmallest = 1e-40;  // likewise below
constexpr std::size_t kMostPoints = std::size_t{1} << 28;
constexpr std::size_t kSampling = 8;  // each round inserts this many times the points before it

constexpr Index Next(Index corner) { return corner == 2 ? 0 : corner + 1; }
constexpr Index Previous(Index corner) { return corner == 0 ? 2 : corner - 1; }

class Triangulation {
 public:
  /// @param points sorted so that neighbours are close; one more is appended as a place for infinity
  explicit Triangulation(std::vector<Eigen::Vector2d> points)
      : points_(std::move(points)), infinity_(static_cast<Index>(points_.size())) {
    points_.emplace_back(0, 0);
    const std::size_t most = 2 * points_.size() + 2;  // Euler: 2 n − 2 triangles, ghosts included
    corners_ = ReserveLarge<Triangle>(most);
    twins_ = ReserveLarge<Triangle>(most);
  }

  /// Makes the first triangle (counter-clockwise) and its three ghosts.
  void Start(Index a, Index b, Index c) {
    corners_ = {{a, b, c}, {infinity_, b, a}, {infinity_, c, b}, {infinity_, a, c}};
    twins_ = {{5, 9, 13}, {10, 0, 12}, {14, 1, 4}, {6, 2, 8}};
  }
  void Insert(Index vertex);

  /// Moves out the triangles that are no ghosts.
  [[nodiscard]] std::vector<Triangle> TakeTriangles() {
    std::erase_if(corners_, [this](const Triangle& triangle) { return IsGhost(triangle); });
    return std::move(corners_);
  }
  /// The vertex at the place where the last inserted one already was; itself when the place was free.
  [[nodiscard]] Index LastInserted() const { return last_inserted_; }

 private:
  [[nodiscard]] bool IsGhost(const Triangle& t) const {
    return t[0] == infinity_ || t[1] == infinity_ || t[2] == infinity_;
  }
  Index& Twin(Index half_edge) { return twins_[half_edge >> 2][half_edge & 3U]; }
  void Join(Index half_edge, Index other) {
    Twin(half_edge) = other;
    Twin(other) = half_edge;
  }
  [[nodiscard]] Index Locate(const Eigen::Vector2d& p);
  [[nodiscard]] bool MustFlip(Index p, Index a, Index b, Index x) const;
  void Split(Index triangle, Index p);
  Index FlipRound(Index triangle);

  std::vector<Eigen::Vector2d> points_;
  Index infinity_;
  std::vector<Triangle> corners_;
  std::vector<Triangle> twins_;
  Index walk_from_ = 0;  // a triangle that is no ghost
  Index last_inserted_ = 0;
};

/// The triangle that holds p in its inside or on its border, or the ghost of a hull edge that p lies beyond.
/// Crossing only edges that p is strictly beyond cannot go round in circles in a Delaunay triangulation.
Index Triangulation::Locate(const Eigen::Vector2d& p) {
  const auto beyond = [&](const Triangle& t, Index corner) {
    return Orientation(points_[t[corner]], points_[t[Next(corner)]], p) < 0;
  };
  Index triangle = walk_from_;
  Index entered = 3;
  for (;;) {
    const Triangle& t = corners_[triangle];
    Index crossed = 3;
    if (entered == 3) {
      for (Index corner = 0; corner < 3 && crossed == 3; ++corner) {
        if (beyond(t, corner)) crossed = corner;
      }
    } else if (beyond(t, Next(entered))) {
      crossed = Next(entered);
    } else if (beyond(t, Previous(entered))) {
      crossed = Previous(entered);
    }
    if (crossed == 3) return triangle;
    const Index twin = twins_[triangle][crossed];
    triangle = twin >> 2;
    entered = twin & 3U;
    if (IsGhost(corners_[triangle])) return triangle;
  }
}

/// Whether edge a–b of the triangle p, a, b has to give way to p–x, x being the corner beyond it.
bool Triangulation::MustFlip(Index p, Index a, Index b, Index x) const {
  const auto& point = points_;
  // The circle of a ghost is the open half-plane beyond its hull edge, and the edge itself.
  if (x == infinity_) return Orientation(point[a], point[b], point[p]) <= 0;
  if (a == infinity_) return Orientation(point[p], point[x], point[b]) > 0;
  if (b == infinity_) return Orientation(point[p], point[a], point[x]) > 0;
  return InCircle(point[b], point[a], point[x], point[p]) > 0;
}

/// Replaces a triangle by three that meet in p, p being the first corner of each.
void Triangulation::Split(Index triangle, Index p) {
  const auto [a, b, c] = corners_[triangle];
  const auto [ab, bc, ca] = twins_[triangle];
  const Index first = 4 * triangle, second = 4 * static_cast<Index>(corners_.size()), third = second + 4;
  corners_[triangle] = {p, a, b};
  corners_.push_back({p, b, c});
  corners_.push_back({p, c, a});
  twins_[triangle] = {third + 2, ab, second};
  twins_.push_back({first + 2, bc, third});
  twins_.push_back({second + 2, ca, first});
  Twin(ab) = first + 1;
  Twin(bc) = second + 1;
  Twin(ca) = third + 1;
}

/// Flips the edges opposite the vertex that is the first corner of `first` and of all triangles round it.
/// @return one of the triangles round it that is no ghost
Index Triangulation::FlipRound(Index first) {
  const Index p = corners_[first][0];
  Index triangle = first, real = first;
  do {
    Triangle& t = corners_[triangle];
    Triangle& t_twins = twins_[triangle];
    for (;;) {
      const Index a = t[1], b = t[2];
      const Index opposite = t_twins[1];
      const Index u = opposite >> 2, corner = opposite & 3U;
      const Index x = corners_[u][Previous(corner)];
      if (!MustFlip(p, a, b, x)) break;
      // p a b | b a x  becomes  p a x | p x b
      const Index beyond_ax = twins_[u][Next(corner)], beyond_xb = twins_[u][Previous(corner)];
      const Index after = t_twins[2];
      t[2] = x;
      t_twins[1] = beyond_ax;
      t_twins[2] = 4 * u;
      corners_[u] = {p, x, b};
      twins_[u] = {4 * triangle + 2, beyond_xb, after};
      Twin(beyond_ax) = 4 * triangle + 1;
      Twin(beyond_xb) = 4 * u + 1;
      Twin(after) = 4 * u + 2;
    }
    if (t[1] != infinity_ && t[2] != infinity_) real = triangle;
    triangle = t_twins[2] >> 2;
  } while (triangle != first);
  return real;
}

void Triangulation::Insert(Index vertex) {
  const Eigen::Vector2d& p = points_[vertex];
  const Index triangle = Locate(p);
  for (const Index corner : corners_[triangle]) {
    if (corner != infinity_ && points_[corner] == p) {
      last_inserted_ = corner;
      return;
    }
  }
  Split(triangle, vertex);
  walk_from_ = FlipRound(triangle);
  last_inserted_ = vertex;
}

/// Three vertices that make a counter-clockwise triangle; false when there are none.
bool FindFirstTriangle(const std::vector<Eigen::Vector2d>& points, Triangle& first) {
  std::size_t b = 1;
  while (b < points.size() && points[b] == points[0]) ++b;
  for (std::size_t c = b + 1; c < points.size(); ++c) {
    const double turn = Orientation(points[0], points[b], points[c]);
    if (turn == 0) continue;
    first = {0, static_cast<Index>(b), static_cast<Index>(c)};
    if (turn < 0) std::swap(first[1], first[2]);
    return true;
  }
  return false;
}

std::vector<Eigen::Vector2d> CheckedCopy(std::span<const Eigen::Vector2d> points) {
  if (points.size() > kMostPoints) throw std::invalid_argument("TriangulateDelaunay: more than 2^28 points");
  auto result = ReserveLarge<Eigen::Vector2d>(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Array2d size = points[i].array().abs();
    if (!((size <= kLargest).all())) {
      throw std::invalid_argument("TriangulateDelaunay: point " + std::to_string(i) +
                                  " has a coordinate that is not finite or beyond ±1e60");
    }
    result.emplace_back((size < kSmallest).select(0.0, points[i].array()));
  }
  return result;
}

}  // namespace

std::vector<Triangle> TriangulateDelaunay(std::span<const Eigen::Vector2d> points) {
  const auto clean = CheckedCopy(points);
  const auto order = OrderAlongHilbertCurve(clean);
  auto sorted = ReserveLarge<Eigen::Vector2d>(clean.size() + 1);
  for (const Index index : order) sorted.push_back(clean[index]);
  Triangle first{};
  if (!FindFirstTriangle(sorted, first)) return {};

  Triangulation triangulation(std::move(sorted));
  triangulation.Start(first[0], first[1], first[2]);
  // Of equal points the lowest index stands for the place, whichever was inserted first.
  std::vector<Index> source = order;
  const auto insert = [&](std::size_t vertex) {
    triangulation.Insert(static_cast<Index>(vertex));
    Index& index = source[triangulation.LastInserted()];
    index = std::min(index, order[vertex]);
  };
  std::size_t stride = 1;
  while (order.size() / stride > kSampling) stride *= kSampling;
  for (std::size_t vertex = 0; vertex < order.size(); vertex += stride) insert(vertex);
  for (; stride > 1; stride /= kSampling) {
    const std::size_t step = stride / kSampling;
    for (std::size_t vertex = 0; vertex < order.size(); vertex += step) {
      if (vertex % stride != 0) insert(vertex);
    }
  }
  auto triangles = triangulation.TakeTriangles();
  for (Triangle& triangle : triangles) {
    for (Index& corner : triangle) corner = source[corner];
  }
  return triangles;
}

}  // namespace granary
