// What stands in the simulated scene besides grain: walls, rim, pillars, floor and the ground outside.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "pipeline/types/bin.h"

namespace granary {

enum class SceneSurface { kNothing, kGrain, kFloor, kWall, kRim, kPillar, kGround };

/// A point that a ray meets; `t` counts in lengths of the ray's direction.
struct SceneHit {
  SceneSurface surface = SceneSurface::kNothing;
  double t = 0;
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< unit, towards the open
};

/// The solid parts, as vertical prisms from z = 0 to the bin's height. Immutable; any number of threads.
class BinShell {
 public:
  /// @param wall_m thickness of the walls, which stand outside the footprint
  BinShell(const Bin& bin, double wall_m);

  /// A point of view with what is fixed for it: only faces that can be seen from it.
  class View {
   public:
    /// First solid that the ray from the view's origin meets. `over_floor` tells whether the ray's way below the bin's
    /// height, up to the hit, is inside the footprint, so that grain may lie before the hit.
    [[nodiscard]] SceneHit First(const Eigen::Vector3d& direction, bool* over_floor) const;
    [[nodiscard]] const Eigen::Vector3d& origin() const { return origin_; }
    /// True when the origin is inside a wall, a pillar or the ground.
    [[nodiscard]] bool Buried() const { return buried_; }

   private:
    friend class BinShell;
    struct Face {
      Eigen::Vector2d normal, along, start;  ///< start relative to the origin
      double length, offset;                 ///< offset: normal·start, below 0
      SceneSurface surface;
    };
    const BinShell* shell_ = nullptr;
    Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
    std::vector<Face> faces_;
    bool above_ = false, inside_ = false, buried_ = false;
  };
  /// Borrows the shell.
  [[nodiscard]] View From(const Eigen::Vector3d& origin) const;

 private:
  struct Outline {
    Polygon corners;  ///< counter-clockwise
    Eigen::Vector2d low, high;
    [[nodiscard]] bool Encloses(const Eigen::Vector2d& point) const;
  };
  static Outline MakeOutline(Polygon corners);

  double height_m_;
  Outline inner_, outer_;
  std::vector<Outline> pillars_;
};

}  // namespace granary
