// Counter-based randomness: a value is a function of where and when it is asked for, so that pictures depend neither on
// the order nor on the number of threads.
#pragma once

#include <cstdint>

namespace granary {

/// 64 well mixed bits of 64. Source: Steele, Lea, Flood, "Fast splittable pseudorandom number generators" (2014), §5.
[[nodiscard]] constexpr std::uint64_t Hash(std::uint64_t value) {
  value += 0x9e3779b97f4a7c15ULL;
  value = (value ^ (value >> 30)) * 0xbf58476d1ce4e5b9ULL;
  value = (value ^ (value >> 27)) * 0x94d049bb133111ebULL;
  return value ^ (value >> 31);
}

/// 64 well mixed bits of a key and a counter.
[[nodiscard]] constexpr std::uint64_t Hash(std::uint64_t key, std::uint64_t counter) {
  return Hash(key ^ Hash(counter));
}

/// Uniform in [0, 1) from the upper bits of a hash.
[[nodiscard]] constexpr double Uniform(std::uint64_t hash) { return static_cast<double>(hash >> 11) * 0x1p-53; }

/// Mean 0, deviation 1, nearly normal: the sum of four uniforms of 16 bits each (no tails beyond 3.5).
[[nodiscard]] constexpr float Normal(std::uint64_t hash) {
  const auto sum =
      static_cast<std::int32_t>((hash & 0xffff) + ((hash >> 16) & 0xffff) + ((hash >> 32) & 0xffff) + (hash >> 48));
  // Each uniform has the variance 65536² / 12, so four have 65536² / 3.
  return static_cast<float>(sum - 2 * 0xffff) * (1.7320508f / 65536.0f);
}

}  // namespace granary
