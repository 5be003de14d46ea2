// Exact signs of the two determinants that a Delaunay triangulation rests on.
#pragma once

#include <cmath>

#include <Eigen/Core>

namespace granary {

/// Sign of the doubled area of the triangle a, b, c from exact arithmetic on all 53 bits of every coordinate.
/// @return > 0 when a, b, c turn counter-clockwise, < 0 clockwise, 0 exactly collinear
/// Coordinates must be 0 or have a magnitude between 1e-40 and 1e60: outside, products would leave double's range.
[[nodiscard]] double ExactOrientation(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c);

/// Sign of the in-circle determinant, from exact arithmetic; the same range of coordinates.
/// @return > 0 when d lies inside the circle through the counter-clockwise triangle a, b, c, < 0 outside, 0 on it
[[nodiscard]] double ExactInCircle(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c,
                                   const Eigen::Vector2d& d);

/// As ExactOrientation, but settled in plain floating point where the rounding error allows it, nearly always.
/// Source of the error bound: Shewchuk, Adaptive precision floating-point arithmetic, 1997, §4.3 (stage A).
[[nodiscard]] inline double Orientation(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  constexpr double kBound = 3.3306690738754716e-16;  // (3 + 16 ε) ε with ε = 2^-53
  const double left = (a.x() - c.x()) * (b.y() - c.y());
  const double right = (a.y() - c.y()) * (b.x() - c.x());
  const double determinant = left - right;
  if (std::abs(determinant) > kBound * (std::abs(left) + std::abs(right))) return determinant;
  return ExactOrientation(a, b, c);
}

/// As ExactInCircle, but settled in plain floating point where the rounding error allows it, nearly always.
/// Source of the error bound: Shewchuk 1997, §4.4 (stage A).
[[nodiscard]] inline double InCircle(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c,
                                     const Eigen::Vector2d& d) {
  constexpr double kBound = 1.1102230246251577e-15;  // (10 + 96 ε) ε
  const double ax = a.x() - d.x(), ay = a.y() - d.y();
  const double bx = b.x() - d.x(), by = b.y() - d.y();
  const double cx = c.x() - d.x(), cy = c.y() - d.y();
  const double bc = bx * cy, cb = cx * by, a_lift = ax * ax + ay * ay;
  const double ca = cx * ay, ac = ax * cy, b_lift = bx * bx + by * by;
  const double ab = ax * by, ba = bx * ay, c_lift = cx * cx + cy * cy;
  const double determinant = a_lift * (bc - cb) + b_lift * (ca - ac) + c_lift * (ab - ba);
  const double permanent = (std::abs(bc) + std::abs(cb)) * a_lift + (std::abs(ca) + std::abs(ac)) * b_lift +
                           (std::abs(ab) + std::abs(ba)) * c_lift;
  if (std::abs(determinant) > kBound * permanent) return determinant;
  return ExactInCircle(a, b, c, d);
}

}  // namespace granary
