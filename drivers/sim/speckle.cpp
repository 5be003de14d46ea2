// Dart throwing on a grid whose cells hold one dot at most, so that a look-up is nine cells.
#include "drivers/sim/speckle.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "drivers/sim/hash.h"

namespace granary {
namespace {

// After kPasses a Poisson disc of this least distance (in pitches) has one dot a pitch² (0.70 a distance² when full).
constexpr double kLeastDistance = 0.82;
constexpr int kPasses = 8;
// A dot falls off as (1 − r²/reach²)³: its full width at half maximum is 0.908 reach, here half a pitch.
constexpr double kReach = 0.55;

}  // namespace

DotPattern::DotPattern(double pitch_tan, double half_width_tan, double half_height_tan, std::uint64_t seed)
    : cell_tan_(kLeastDistance * pitch_tan / std::sqrt(2.0)) {
  columns_ = 2 + static_cast<int>(std::ceil(2 * half_width_tan / cell_tan_));
  rows_ = 2 + static_cast<int>(std::ceil(2 * half_height_tan / cell_tan_));
  left_tan_ = -half_width_tan - cell_tan_;
  top_tan_ = -half_height_tan - cell_tan_;
  const double reach = std::min(1.0, kReach * pitch_tan / cell_tan_);
  inverse_reach_ = static_cast<float>(1 / (reach * reach));
  dots_.resize(static_cast<std::size_t>(columns_) * rows_);

  constexpr float kLeastSquared = 2.0f;  // in cells: a cell is the least distance / √2
  for (int pass = 0; pass < kPasses; ++pass) {
    for (int j = 1; j < rows_ - 1; ++j) {
      for (int i = 1; i < columns_ - 1; ++i) {
        Dot& here = dots_[static_cast<std::size_t>(j) * columns_ + i];
        if (here.power > 0) continue;
        const std::uint64_t hash = Hash(seed, (static_cast<std::uint64_t>(j) << 32 | i) * kPasses + pass);
        const Dot dart{static_cast<float>(i + Uniform(hash)), static_cast<float>(j + Uniform(Hash(hash))), 0};
        bool apart = true;
        for (int y = std::max(0, j - 2); apart && y <= std::min(rows_ - 1, j + 2); ++y) {
          for (int x = std::max(0, i - 2); x <= std::min(columns_ - 1, i + 2); ++x) {
            const Dot& other = dots_[static_cast<std::size_t>(y) * columns_ + x];
            const float dx = other.x - dart.x, dy = other.y - dart.y;
            if (dx * dx + dy * dy < kLeastSquared) {
              apart = false;
              break;
            }
          }
        }
        if (!apart) continue;
        here = dart;
        here.power = static_cast<float>(0.7 + 0.3 * Uniform(Hash(hash ^ 1)));
      }
    }
  }
}

float DotPattern::At(double x_tan, double y_tan) const {
  const double u = (x_tan - left_tan_) / cell_tan_, v = (y_tan - top_tan_) / cell_tan_;
  if (!(u >= 1 && v >= 1 && u < columns_ - 1 && v < rows_ - 1)) return 0;
  const int i = static_cast<int>(u), j = static_cast<int>(v);
  const auto x = static_cast<float>(u), y = static_cast<float>(v);
  float light = 0;
  for (int row = j - 1; row <= j + 1; ++row) {
    const Dot* dot = &dots_[static_cast<std::size_t>(row) * columns_ + i - 1];
    for (int k = 0; k < 3; ++k) {
      const float dx = dot[k].x - x, dy = dot[k].y - y;
      const float rest = std::max(0.0f, 1 - (dx * dx + dy * dy) * inverse_reach_);
      light += dot[k].power * rest * rest * rest;
    }
  }
  return light;
}

std::vector<std::pair<double, double>> DotPattern::Dots() const {
  std::vector<std::pair<double, double>> dots;
  for (const Dot& dot : dots_) {
    if (dot.power > 0) dots.emplace_back(left_tan_ + dot.x * cell_tan_, top_tan_ + dot.y * cell_tan_);
  }
  return dots;
}

}  // namespace granary
