// Points are keyed by the Hilbert number of their cell in a grid with about two cells a point, and sorted by counting.
// Cells that still hold many points (an outlier has stretched the grid, or points crowd) are ordered again inside.
#include "pipeline/hilbert.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "pipeline/large_pages.h"

namespace granary {
namespace {

constexpr int kDigitBits = 11;  // of the counting sort: 2048 counters stay in the first-level cache
constexpr std::size_t kCrowdedCell = 32;

struct Keyed {
  std::uint32_t key;
  std::uint32_t index;
};

/// Position along the curve of cell (x, y) in a grid of 2^bits × 2^bits.
/// The curve in a quadrant is the whole curve mirrored (flip) or transposed (swap).
std::uint32_t HilbertKey(std::uint32_t x, std::uint32_t y, int bits) {
  std::uint32_t key = 0, swap = 0, flip = 0;
  for (int level = bits - 1; level >= 0; --level) {
    const std::uint32_t bit_x = (x >> level) & 1U, bit_y = (y >> level) & 1U;
    const std::uint32_t exchange = (bit_x ^ bit_y) & swap;
    const std::uint32_t u = bit_x ^ exchange ^ flip, v = bit_y ^ exchange ^ flip;
    key = (key << 2) | ((3U * u) ^ v);
    flip ^= u & (v ^ 1U);
    swap ^= v ^ 1U;
  }
  return key;
}

void SortByKey(std::vector<Keyed>& items, int key_bits) {
  auto other = ReserveLarge<Keyed>(items.size());
  other.resize(items.size());
  for (int shift = 0; shift < key_bits; shift += kDigitBits) {
    std::array<std::uint32_t, std::size_t{1} << kDigitBits> start{};
    const auto digit = [shift](const Keyed& item) { return (item.key >> shift) & ((1U << kDigitBits) - 1); };
    for (const Keyed& item : items) ++start[digit(item)];
    std::uint32_t sum = 0;
    for (auto& entry : start) sum += std::exchange(entry, sum);
    for (const Keyed& item : items) other[start[digit(item)]++] = item;
    items.swap(other);
  }
}

void SortAlongCurve(std::span<const Eigen::Vector2d> points, std::span<std::uint32_t> order) {
  Eigen::Array2d low = points[order[0]], high = low;
  for (const std::uint32_t index : order) {
    low = low.min(points[index].array());
    high = high.max(points[index].array());
  }
  const Eigen::Array2d extent = high - low;
  if (extent.maxCoeff() <= 0) return;

  const int bits = std::clamp((static_cast<int>(std::bit_width(order.size())) + 1) / 2, 4, 14);
  const double cells = std::ldexp(1.0, bits);
  const Eigen::Array2d scale = (extent > 0).select(cells / extent, 0.0);
  const auto cell = [last = static_cast<std::uint32_t>(cells) - 1](double position) {
    return std::min(last, static_cast<std::uint32_t>(position));
  };
  auto items = ReserveLarge<Keyed>(order.size());
  for (const std::uint32_t index : order) {
    // min() before the cast: cells / extent overflows where the extent is denormal
    const Eigen::Array2d position = ((points[index].array() - low) * scale).min(cells);
    items.push_back({HilbertKey(cell(position.x()), cell(position.y()), bits), index});
  }
  SortByKey(items, 2 * bits);

  for (std::size_t begin = 0; begin < items.size();) {
    std::size_t end = begin;
    for (; end < items.size() && items[end].key == items[begin].key; ++end) order[end] = items[end].index;
    if (end - begin > kCrowdedCell && end - begin < order.size())
      SortAlongCurve(points, order.subspan(begin, end - begin));
    begin = end;
  }
}

}  // namespace

std::vector<std::uint32_t> OrderAlongHilbertCurve(std::span<const Eigen::Vector2d> points) {
  auto order = ReserveLarge<std::uint32_t>(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) order.push_back(static_cast<std::uint32_t>(i));
  if (!order.empty()) SortAlongCurve(points, order);
  return order;
}

}  // namespace granary
