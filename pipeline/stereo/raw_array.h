// Memory for inner loops: aligned for any vector, on large pages where it is large, kept for the next use.
#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>

namespace granary {

/// An array of a plain type whose elements have no value until they are written.
template <typename T>
class RawArray {
 public:
  RawArray() = default;
  explicit RawArray(std::size_t count) { Reserve(count); }

  /// Room for at least `count` elements; what was there is lost when it has to grow. Large pages are asked for, since
  /// fresh small ones cost a virtual machine more than the work done on them.
  void Reserve(std::size_t count) {
    if (count <= capacity_) return;
    data_.reset();
    capacity_ = 0;
    constexpr std::size_t kLine = 64, kLargePage = std::size_t{2} << 20;
    const std::size_t alignment = count * sizeof(T) < kLargePage ? kLine : kLargePage;
    const std::size_t bytes = (count * sizeof(T) + alignment - 1) / alignment * alignment;
    data_.reset(static_cast<T*>(std::aligned_alloc(alignment, bytes)));
    if (data_ == nullptr) throw std::bad_alloc();
    if (alignment == kLargePage) (void)madvise(data_.get(), bytes, MADV_HUGEPAGE);
    capacity_ = count;
  }
  [[nodiscard]] T* data() { return data_.get(); }
  [[nodiscard]] const T* data() const { return data_.get(); }
  [[nodiscard]] std::size_t capacity() const { return capacity_; }

 private:
  struct Free {
    void operator()(T* pointer) const { std::free(pointer); }
  };
  std::unique_ptr<T, Free> data_;
  std::size_t capacity_ = 0;
};

}  // namespace granary
