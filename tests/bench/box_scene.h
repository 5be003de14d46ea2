// What a camera over the paper's box sees of it, for benchmarks of the geometry: 1.3 million points in picture order.
#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Core>

namespace granary {

struct BoxScene {
  static constexpr int kWidth = 1300, kHeight = 1000;                           ///< pixels
  static constexpr double kLength = 0.52, kBreadth = 0.355, kTop = 0.285;       ///< metres
  static constexpr double kCamera = 1.1, kFocal_px = 2400, kBaseline_m = 0.11;  ///< straight above the middle
};

/// Noise 0.3 mm; empty, or filled 5 to 15 cm deep.
inline std::vector<Eigen::Vector3f> SeeBox(bool filled, unsigned seed) {
  using S = BoxScene;
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 0.0003);
  std::vector<Eigen::Vector3f> cloud;
  cloud.reserve(static_cast<std::size_t>(S::kWidth) * S::kHeight);
  const Eigen::Vector3d camera(S::kLength / 2, S::kBreadth / 2, S::kCamera);
  for (int v = 0; v < S::kHeight; ++v) {
    for (int u = 0; u < S::kWidth; ++u) {
      const double dx = (u - S::kWidth / 2.0) / S::kFocal_px, dy = (v - S::kHeight / 2.0) / S::kFocal_px;
      double z = 0;
      if (filled) {
        for (int i = 0; i < 20; ++i) {
          const double x = camera.x() + dx * (S::kCamera - z), y = camera.y() + dy * (S::kCamera - z);
          z = 0.10 + 0.05 * std::sin(6 * x) * std::cos(5 * y);
        }
      }
      double depth = S::kCamera - z;
      const double to_wall =
          std::min(S::kLength / 2 / std::max(std::abs(dx), 1e-9), S::kBreadth / 2 / std::max(std::abs(dy), 1e-9));
      if (to_wall < depth && S::kCamera - to_wall < S::kTop) depth = to_wall;  // a wall inside the box
      if (to_wall <= S::kCamera - S::kTop) depth = S::kCamera;                 // past the rim, the ground outside
      const Eigen::Vector3d point = camera + (depth + noise(random)) * Eigen::Vector3d(dx, dy, -1);
      cloud.push_back(point.cast<float>());
    }
  }
  return cloud;
}

}  // namespace granary
