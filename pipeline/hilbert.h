// An order in which neighbours in the plane come close together in memory.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace granary {

/// The indices of `points` along a Hilbert curve that is refined where points crowd. Points with equal coordinates keep
/// their order. The coordinates must be finite.
[[nodiscard]] std::vector<std::uint32_t> OrderAlongHilbertCurve(std::span<const Eigen::Vector2d> points);

}  // namespace granary
