// A floor plan is checked before anything is integrated over it: the shoelace formula gives a confident wrong area for
// a polygon that crosses itself, and coordinates typed in millimetres give a bin of a kilometre.
#include "pipeline/types/bin_faults.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace granary {
namespace {

constexpr double kTouch_m = 1e-6;         // corners nearer than a micrometre are the same corner
constexpr double kMinArea_m2 = 1e-6;      // a square millimetre
constexpr double kMaxCoordinate_m = 500;  // beyond any store; catches millimetres typed for metres

double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Distance of `point` from the segment a–b, m.
double Distance_m(const Eigen::Vector2d& point, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  const Eigen::Vector2d ab = b - a;
  const double along = std::clamp((point - a).dot(ab) / std::max(ab.squaredNorm(), 1e-300), 0.0, 1.0);
  return (point - (a + along * ab)).norm();
}

double DistanceToBorder_m(const Polygon& polygon, const Eigen::Vector2d& point) {
  double nearest_m = 1e300;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    nearest_m = std::min(nearest_m, Distance_m(point, polygon[i], polygon[(i + 1) % polygon.size()]));
  }
  return nearest_m;
}

/// True when the open segments a–b and c–d cross in one inner point of both.
bool SegmentsCross(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c,
                   const Eigen::Vector2d& d) {
  const double c_side = Cross(b - a, c - a), d_side = Cross(b - a, d - a);
  const double a_side = Cross(d - c, a - c), b_side = Cross(d - c, b - c);
  return c_side * d_side < 0 && a_side * b_side < 0;
}

bool BordersCross(const Polygon& one, const Polygon& other) {
  for (std::size_t i = 0; i < one.size(); ++i) {
    for (std::size_t j = 0; j < other.size(); ++j) {
      if (SegmentsCross(one[i], one[(i + 1) % one.size()], other[j], other[(j + 1) % other.size()])) return true;
    }
  }
  return false;
}

/// True when a corner lies on an edge that is not its own: a spike or a pinch.
bool TouchesItself(const Polygon& polygon) {
  const std::size_t n = polygon.size();
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < n; ++k) {
      if (k == i || k == (i + 1) % n) continue;
      if (Distance_m(polygon[k], polygon[i], polygon[(i + 1) % n]) < kTouch_m) return true;
    }
  }
  return false;
}

bool HasCornerInside(const Polygon& outer, const Polygon& inner) {
  return std::any_of(inner.begin(), inner.end(), [&](const Eigen::Vector2d& corner) {
    return Contains(outer, corner) && DistanceToBorder_m(outer, corner) > kTouch_m;
  });
}

bool IsWithin(const Polygon& outer, const Polygon& inner) {
  const bool corners_within = std::all_of(inner.begin(), inner.end(), [&](const Eigen::Vector2d& corner) {
    return Contains(outer, corner) || DistanceToBorder_m(outer, corner) <= kTouch_m;
  });
  return corners_within && !BordersCross(outer, inner) && !HasCornerInside(inner, outer);
}

bool HasSameCorners(const Polygon& one, const Polygon& other) {
  return std::all_of(one.begin(), one.end(), [&](const Eigen::Vector2d& corner) {
    return std::any_of(other.begin(), other.end(), [&](const auto& c) { return (c - corner).norm() <= kTouch_m; });
  });
}

bool Overlap(const Polygon& one, const Polygon& other) {
  return BordersCross(one, other) || HasCornerInside(one, other) || HasCornerInside(other, one) ||
         HasSameCorners(one, other);
}

}  // namespace

std::string PolygonFault(const Polygon& polygon) {
  const std::size_t n = polygon.size();
  if (n < 3) return "has " + std::to_string(n) + " corners; must have at least 3, each [x, y] in metres";
  for (const auto& corner : polygon) {
    if (!corner.allFinite() || corner.cwiseAbs().maxCoeff() > kMaxCoordinate_m) {
      return "has a corner out of range; coordinates are metres and must be -500 to 500";
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    if ((polygon[i] - polygon[(i + 1) % n]).norm() < kTouch_m) {
      return "repeats a corner; must name each corner once, the last joins the first by itself";
    }
  }
  if (BordersCross(polygon, polygon)) return "crosses itself; must list the corners in order around the floor";
  if (Area_m2(polygon) < kMinArea_m2) return "has no area; must enclose some floor, in metres";
  if (TouchesItself(polygon)) return "touches itself; must list the corners in order around the floor";
  return {};
}

std::vector<std::string> Faults(const Bin& bin) {
  std::vector<std::string> faults;
  if (bin.id < 1 || bin.id > 247) faults.emplace_back("id: must be 1 to 247");
  const std::string outline = PolygonFault(bin.footprint_m);
  if (!outline.empty()) faults.push_back("footprint_m: " + outline);
  for (std::size_t i = 0; i < bin.exclude_m.size(); ++i) {
    const std::string key = "exclude_m[" + std::to_string(i) + "]: ";
    const std::string words = PolygonFault(bin.exclude_m[i]);
    if (!words.empty()) {
      faults.push_back(key + words);
      continue;
    }
    if (outline.empty() && !IsWithin(bin.footprint_m, bin.exclude_m[i])) {
      faults.push_back(key + "leaves the footprint; must lie inside footprint_m");
    }
    for (std::size_t j = 0; j < i; ++j) {
      if (PolygonFault(bin.exclude_m[j]).empty() && Overlap(bin.exclude_m[i], bin.exclude_m[j])) {
        faults.push_back(key + "overlaps exclude_m[" + std::to_string(j) + "]; must not, its floor would count twice");
      }
    }
  }
  if (faults.empty() && GrainFloor_m2(bin) < kMinArea_m2) {
    faults.emplace_back("exclude_m: leaves no floor for grain; must be less than the footprint");
  }
  if (!(bin.height_m > 0 && bin.height_m <= 100)) faults.emplace_back("height_m: must be more than 0 and at most 100");
  return faults;
}

std::vector<std::string> Faults(const GrainKind& grain) {
  std::vector<std::string> faults;
  const auto require = [&](bool ok, const char* words) {
    if (!ok) faults.emplace_back(words);
  };
  require(!grain.surface_offset_m || std::abs(*grain.surface_offset_m) <= 0.02,
          "surface_offset_m: must be -0.02 to 0.02");
  require(!grain.surface_offset_u95_m || (*grain.surface_offset_u95_m >= 0 && *grain.surface_offset_u95_m <= 0.02),
          "surface_offset_u95_m: must be 0 to 0.02");
  require(!grain.surface_offset_u95_m || grain.surface_offset_m,
          "surface_offset_u95_m: goes with surface_offset_m, which is not set");
  require(!grain.angle_of_repose_deg || (*grain.angle_of_repose_deg >= 5 && *grain.angle_of_repose_deg <= 60),
          "angle_of_repose_deg: must be 5 to 60");
  return faults;
}

std::vector<std::string> Faults(const Inventory& inventory) {
  std::vector<std::string> faults;
  const auto require = [&](bool ok, const char* words) {
    if (!ok) faults.emplace_back(words);
  };
  require(!inventory.book_mass_kg || *inventory.book_mass_kg >= 0, "book_mass_kg: must be 0 or more");
  require(!inventory.density_kg_m3 || (*inventory.density_kg_m3 >= 1 && *inventory.density_kg_m3 <= 2000),
          "density_kg_m3: must be 1 to 2000");
  require(
      !inventory.density_u95_percent || (*inventory.density_u95_percent >= 0 && *inventory.density_u95_percent <= 100),
      "density_u95_percent: must be 0 to 100");
  require(inventory.correction > 0 && inventory.correction <= 10, "correction: must be more than 0 and at most 10");
  require(inventory.loss_kg >= 0, "loss_kg: must be 0 or more");
  require(inventory.alarm_percent > 0 && inventory.alarm_percent <= 100,
          "alarm_percent: must be more than 0 and at most 100");
  return faults;
}

}  // namespace granary
