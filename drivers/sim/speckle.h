// The projector's fixed pattern of dots.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

namespace granary {

/// Pseudo-random dots on the projector's tangent plane, none nearer to another than a set distance (Poisson disc),
/// each a little different in power. Immutable; any number of threads.
class DotPattern {
 public:
  /// @param pitch_tan       mean distance of neighbouring dots, tangent of the angle
  /// @param half_width_tan  the pattern covers ±this in x
  /// @param half_height_tan and ±this in y; it is dark beyond
  DotPattern(double pitch_tan, double half_width_tan, double half_height_tan, std::uint64_t seed);

  /// Light in the direction (x, y, 1): 1 in the middle of a strong dot, 0 between dots.
  [[nodiscard]] float At(double x_tan, double y_tan) const;
  /// Dots as x, y in tangents, for tests.
  [[nodiscard]] std::vector<std::pair<double, double>> Dots() const;

 private:
  struct Dot {
    float x = kFar, y = kFar;  ///< in cells from the pattern's corner
    float power = 0;
  };
  static constexpr float kFar = 1e9f;
  double cell_tan_, left_tan_, top_tan_;
  int columns_, rows_;     ///< with a border of one empty cell all round
  float inverse_reach_;    ///< 1 / reach², reach of a dot in cells
  std::vector<Dot> dots_;  ///< at most one a cell
};

}  // namespace granary
