// A surface is clip(level + form + bumps, 0, bin height); the level that gives the volume is found by bisection on the
// very sum that is the truth.
#include "drivers/sim/grain.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "drivers/sim/hash.h"

namespace granary {
namespace {

constexpr int kCellsAlong = 520;  // 1 mm in the paper's box
// Share of the bin's size (the root of its floor area), so 0.5 mm and 10 mm in the paper's box.
constexpr double kBumpHeight = 0.0012;
constexpr double kBumpSpacing = 0.023;

// Smooth noise in [-1, 1] on a unit lattice: random values at the nodes, a quintic in between (continuous curvature).
double SmoothNoise(double x, double y, std::uint64_t key) {
  const double fx = std::floor(x), fy = std::floor(y);
  const auto fade = [](double s) { return s * s * s * (s * (s * 6 - 15) + 10); };
  const double p = fade(x - fx), q = fade(y - fy);
  const auto node = [&](int i, int j) {
    const auto column = static_cast<std::uint32_t>(static_cast<std::int32_t>(fx) + i);
    const auto row = static_cast<std::uint32_t>(static_cast<std::int32_t>(fy) + j);
    return 2 * Uniform(Hash(key, (static_cast<std::uint64_t>(row) << 32) | column)) - 1;
  };
  return (1 - q) * ((1 - p) * node(0, 0) + p * node(1, 0)) + q * ((1 - p) * node(0, 1) + p * node(1, 1));
}

// The shape's height at `at`, metres from the middle of the bin, with half sizes `half`. Left is towards x = 0.
double FormAt(SimShape shape, const Eigen::Vector2d& at, const Eigen::Vector2d& half) {
  constexpr double kTilt = 0.40;
  const double round_m = 0.2 * half.minCoeff();  // the cone's tip is rounded over this radius
  switch (shape) {
    case SimShape::kFlat:
      return 0;
    case SimShape::kTiltedLeft:  // higher on the left
      return -kTilt * at.x();
    case SimShape::kTiltedRight:
      return kTilt * at.x();
    case SimShape::kConvex:
      return -kTilt * std::hypot(at.norm(), round_m);
    case SimShape::kConcave:
      return kTilt * std::hypot(at.norm(), round_m);
    case SimShape::kPartial:  // a wedge against the left wall, its toe bent a little
      return -Grain::kSteepest * (at.x() + 0.06 * at.y() * at.y() / half.y());
  }
  throw std::logic_error("FormAt: no such shape");
}

double WeightedSum(const std::vector<double>& weights, const std::vector<double>& values) {
  double sum = 0;
  for (std::size_t k = 0; k < values.size(); ++k) sum += weights[k] * values[k];
  return sum;
}

}  // namespace

Grain::Grain(const Bin& bin, SimShape shape, std::uint64_t seed)
    : bin_id_(bin.id),
      height_m_(bin.height_m),
      partial_(shape == SimShape::kPartial),
      grid_(GridOver(bin.footprint_m, kCellsAlong)),
      weights_m2_(NodeWeights_m2(grid_, bin.footprint_m, bin.exclude_m)) {
  if (!(height_m_ > 0)) throw std::invalid_argument("height_m: must be above 0");
  for (const double w : weights_m2_) floor_m2_ += w;
  if (!(floor_m2_ > 0)) throw std::invalid_argument("exclude_m: leaves no floor");

  const double size_m = std::sqrt(floor_m2_);
  const double spacing_m = kBumpSpacing * size_m;
  const Eigen::Vector2d half((grid_.columns - 1) * grid_.cell_m.x() / 2, (grid_.rows - 1) * grid_.cell_m.y() / 2);
  form_m_.reserve(grid_.z_m.size());
  bumps_m_.reserve(grid_.z_m.size());
  for (int j = 0; j < grid_.rows; ++j) {
    for (int i = 0; i < grid_.columns; ++i) {
      const Eigen::Vector2d at(i * grid_.cell_m.x() - half.x(), j * grid_.cell_m.y() - half.y());
      form_m_.push_back(FormAt(shape, at, half));
      const double coarse = SmoothNoise(at.x() / spacing_m, at.y() / spacing_m, Hash(seed, 1));
      const double fine = SmoothNoise(2 * at.x() / spacing_m, 2 * at.y() / spacing_m, Hash(seed, 2));
      bumps_m_.push_back(kBumpHeight * size_m * (0.8 * coarse + 0.2 * fine));
    }
  }
  for (auto* part : {&form_m_, &bumps_m_}) {
    const double mean = WeightedSum(weights_m2_, *part) / floor_m2_;
    for (double& z : *part) z -= mean;
  }
}

double Grain::Volume_m3(const HeightField& surface) const { return WeightedSum(weights_m2_, surface.z_m); }

HeightField Grain::SurfaceOf(double volume_m3) const {
  if (!(volume_m3 >= 0) || volume_m3 > Capacity_m3()) {
    char text[160];
    std::snprintf(text, sizeof text, "sim.volume_m3: %g does not fit into bin %d, allowed is 0 to %g", volume_m3,
                  bin_id_, Capacity_m3());
    throw std::invalid_argument(text);
  }
  HeightField surface = grid_;
  if (volume_m3 == 0) return surface;

  // Room below and above the mean level: the form takes most of it, the bumps the rest, so that nothing is clipped.
  const double mean_m = volume_m3 / floor_m2_;
  const auto scale = [&](const std::vector<double>& part, double share) {
    const auto [low, high] = std::minmax_element(part.begin(), part.end());
    double s = 1;
    if (*low < 0) s = std::min(s, share * mean_m / -*low);
    if (*high > 0) s = std::min(s, share * (height_m_ - mean_m) / *high);
    return s;
  };
  const double form_scale = partial_ ? 1 : scale(form_m_, 0.8), bump_scale = scale(bumps_m_, 0.15);
  const auto fill = [&](double level_m) {
    for (std::size_t k = 0; k < surface.z_m.size(); ++k) {
      const double z = level_m + form_scale * form_m_[k] + bump_scale * bumps_m_[k];
      surface.z_m[k] = std::clamp(z, 0.0, height_m_);
    }
    return Volume_m3(surface);
  };

  const auto [low_form, high_form] = std::minmax_element(form_m_.begin(), form_m_.end());
  double low = -(*high_form + height_m_), high = height_m_ - *low_form + height_m_;
  for (int i = 0; i < 80; ++i) {
    const double middle = (low + high) / 2;
    const double got = fill(middle);
    if (std::abs(got - volume_m3) <= 1e-13 * volume_m3) break;
    (got < volume_m3 ? low : high) = middle;
  }
  return surface;
}

}  // namespace granary
