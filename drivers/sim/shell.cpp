// A ray meets, from above, first the plane of the rim: there it is decided whether it goes on inside the bin, outside,
// or ends on a rim or a pillar's head. Below that plane only upright faces and the ground remain.
#include "drivers/sim/shell.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace granary {
namespace {

constexpr double kSeam = 1e-9;  // metres (and shares) by which faces overlap at corners, so that no ray slips through

double SignedArea(const Polygon& corners) {
  double twice = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const auto& a = corners[i];
    const auto& b = corners[(i + 1) % corners.size()];
    twice += a.x() * b.y() - b.x() * a.y();
  }
  return twice / 2;
}

// Unit normal of an edge of a counter-clockwise polygon, outwards.
Eigen::Vector2d Outwards(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  const Eigen::Vector2d along = (b - a).normalized();
  return {along.y(), -along.x()};
}

// Every edge moved outwards by `by_m`; corners are mitred, very sharp ones cut short.
Polygon Grown(const Polygon& corners, double by_m) {
  Polygon grown;
  const std::size_t n = corners.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector2d before = Outwards(corners[(i + n - 1) % n], corners[i]);
    const Eigen::Vector2d after = Outwards(corners[i], corners[(i + 1) % n]);
    const double half_cosine_squared = std::max(0.1, (1 + before.dot(after)) / 2);
    grown.push_back(corners[i] + (before + after) / 2 * (by_m / half_cosine_squared));
  }
  return grown;
}

}  // namespace

BinShell::Outline BinShell::MakeOutline(Polygon corners) {
  if (SignedArea(corners) < 0) std::reverse(corners.begin(), corners.end());
  Outline outline{corners, corners.front(), corners.front()};
  for (const auto& p : corners) {
    outline.low = outline.low.cwiseMin(p);
    outline.high = outline.high.cwiseMax(p);
  }
  return outline;
}

bool BinShell::Outline::Encloses(const Eigen::Vector2d& point) const {
  if (point.x() < low.x() || point.y() < low.y() || point.x() > high.x() || point.y() > high.y()) return false;
  bool inside = false;
  for (std::size_t i = 0, j = corners.size() - 1; i < corners.size(); j = i++) {
    const auto& a = corners[i];
    const auto& b = corners[j];
    if ((a.y() > point.y()) != (b.y() > point.y()) &&
        point.x() < (b.x() - a.x()) * (point.y() - a.y()) / (b.y() - a.y()) + a.x()) {
      inside = !inside;
    }
  }
  return inside;
}

BinShell::BinShell(const Bin& bin, double wall_m) : height_m_(bin.height_m), inner_(MakeOutline(bin.footprint_m)) {
  outer_ = MakeOutline(Grown(inner_.corners, wall_m));
  for (const auto& pillar : bin.exclude_m) pillars_.push_back(MakeOutline(pillar));
}

BinShell::View BinShell::From(const Eigen::Vector3d& origin) const {
  View view;
  view.shell_ = this;
  view.origin_ = origin;
  const Eigen::Vector2d at = origin.head<2>();
  view.above_ = origin.z() > height_m_;
  view.inside_ = inner_.Encloses(at);
  view.buried_ = origin.z() <= 0;
  if (!view.above_) {
    view.buried_ = view.buried_ || (outer_.Encloses(at) && !view.inside_);
    for (const auto& pillar : pillars_) view.buried_ = view.buried_ || pillar.Encloses(at);
  }
  const auto add = [&](const Outline& outline, double facing, SceneSurface surface) {
    for (std::size_t i = 0; i < outline.corners.size(); ++i) {
      const Eigen::Vector2d& a = outline.corners[i];
      const Eigen::Vector2d& b = outline.corners[(i + 1) % outline.corners.size()];
      View::Face face{facing * Outwards(a, b), (b - a).normalized(), a - at, (b - a).norm(), 0, surface};
      face.offset = face.normal.dot(face.start);
      if (face.offset < 0) view.faces_.push_back(face);  // its front is towards the origin
    }
  };
  add(inner_, -1, SceneSurface::kWall);
  add(outer_, 1, SceneSurface::kWall);
  for (const auto& pillar : pillars_) add(pillar, 1, SceneSurface::kPillar);
  return view;
}

SceneHit BinShell::View::First(const Eigen::Vector3d& direction, bool* over_floor) const {
  const double top_m = shell_->height_m_;
  bool inside = inside_;
  if (above_) {
    *over_floor = false;
    if (direction.z() >= 0) return {};
    const double t = (top_m - origin_.z()) / direction.z();
    const Eigen::Vector2d at = origin_.head<2>() + t * direction.head<2>();
    inside = shell_->inner_.Encloses(at);
    if (!inside && shell_->outer_.Encloses(at)) return {SceneSurface::kRim, t, Eigen::Vector3d::UnitZ()};
    for (const auto& pillar : shell_->pillars_) {
      if (pillar.Encloses(at)) return {SceneSurface::kPillar, t, Eigen::Vector3d::UnitZ()};
    }
  }
  *over_floor = inside;

  double t = std::numeric_limits<double>::infinity();
  if (direction.z() < 0) t = -origin_.z() / direction.z();
  const Face* nearest = nullptr;
  for (const Face& face : faces_) {
    const double approach = face.normal.x() * direction.x() + face.normal.y() * direction.y();
    if (approach >= 0) continue;
    const double to_face = face.offset / approach;
    if (to_face >= t) continue;
    const double along = (to_face * direction.x() - face.start.x()) * face.along.x() +
                         (to_face * direction.y() - face.start.y()) * face.along.y();
    if (along < -kSeam || along > face.length + kSeam) continue;
    const double z = origin_.z() + to_face * direction.z();
    if (z > top_m * (1 + kSeam) || z < -kSeam) continue;
    t = to_face;
    nearest = &face;
  }
  if (nearest != nullptr) return {nearest->surface, t, {nearest->normal.x(), nearest->normal.y(), 0}};
  if (std::isinf(t)) return {};
  return {inside ? SceneSurface::kFloor : SceneSurface::kGround, t, Eigen::Vector3d::UnitZ()};
}

}  // namespace granary
