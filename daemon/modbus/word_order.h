// 32-bit values and the two registers that they take.
#pragma once

#include <cstdint>
#include <span>
#include <utility>

#include "daemon/options.h"

namespace granary {

[[nodiscard]] constexpr std::uint16_t SwapBytes(std::uint16_t word) {
  return static_cast<std::uint16_t>((word << 8) | (word >> 8));
}
[[nodiscard]] constexpr bool IsLowWordFirst(ByteOrder order) {
  return order == ByteOrder::kCdab || order == ByteOrder::kDcba;
}
[[nodiscard]] constexpr bool HasBytesSwapped(ByteOrder order) {
  return order == ByteOrder::kDcba || order == ByteOrder::kBadc;
}

/// Writes a value into two registers.
constexpr void Put32(std::uint32_t value, ByteOrder order, std::span<std::uint16_t> words) {
  auto first = static_cast<std::uint16_t>(value >> 16), second = static_cast<std::uint16_t>(value);
  if (IsLowWordFirst(order)) std::swap(first, second);
  words[0] = HasBytesSwapped(order) ? SwapBytes(first) : first;
  words[1] = HasBytesSwapped(order) ? SwapBytes(second) : second;
}

/// The inverse.
[[nodiscard]] constexpr std::uint32_t Take32(std::span<const std::uint16_t> words, ByteOrder order) {
  std::uint16_t high = words[0], low = words[1];
  if (IsLowWordFirst(order)) std::swap(high, low);
  if (HasBytesSwapped(order)) {
    high = SwapBytes(high);
    low = SwapBytes(low);
  }
  return (std::uint32_t{high} << 16) | low;
}

}  // namespace granary
