// Large arrays on large pages: a fresh 4 kB page costs about 15 µs in a virtual machine, a 2 MB page 250 µs.
#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace granary {

/// `bytes` of memory aligned for any vector, for which the kernel is asked to use 2 MB pages when there are that many.
/// @throws std::bad_alloc
[[nodiscard]] void* AllocateLarge(std::size_t bytes);
void FreeLarge(void* memory);

/// From now on the pixels of every new cv::Mat come from AllocateLarge. For main() to call before there are threads: a
/// cycle makes a hundred pictures anew, and their fresh small pages would take longer than what is done with them.
void UseLargePagesForPictures();

/// An empty vector with room for `count` elements, for which the kernel is asked to use 2 MB pages.
/// Only a hint: where the kernel has none to give, the vector is slower to fill and otherwise the same.
template <typename T>
[[nodiscard]] std::vector<T> ReserveLarge(std::size_t count) {
  constexpr std::uintptr_t kPage = std::uintptr_t{2} << 20;
  std::vector<T> result;
  result.reserve(count);
  const auto begin = (reinterpret_cast<std::uintptr_t>(result.data()) + kPage - 1) & ~(kPage - 1);
  const auto end = reinterpret_cast<std::uintptr_t>(result.data() + count) & ~(kPage - 1);
  if (begin < end) (void)madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
  return result;
}

/// `count` value-initialised elements on large pages.
template <typename T>
[[nodiscard]] std::vector<T> MakeLarge(std::size_t count) {
  auto result = ReserveLarge<T>(count);
  result.resize(count);
  return result;
}

}  // namespace granary
