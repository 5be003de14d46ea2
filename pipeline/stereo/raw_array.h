// Memory for inner loops: aligned for any vector, on large pages where it is large, kept for the next use.
#pragma once

#include <cstddef>
#include <memory>

#include "pipeline/large_pages.h"

namespace granary {

/// An array of a plain type whose elements have no value until they are written.
template <typename T>
class RawArray {
 public:
  RawArray() = default;
  explicit RawArray(std::size_t count) { Reserve(count); }

  /// Room for at least `count` elements; what was there is lost when it has to grow.
  void Reserve(std::size_t count) {
    if (count <= capacity_) return;
    data_.reset();
    capacity_ = 0;
    data_.reset(static_cast<T*>(AllocateLarge(count * sizeof(T))));
    capacity_ = count;
  }
  [[nodiscard]] T* data() { return data_.get(); }
  [[nodiscard]] const T* data() const { return data_.get(); }
  [[nodiscard]] std::size_t capacity() const { return capacity_; }

 private:
  struct Free {
    void operator()(T* pointer) const { FreeLarge(pointer); }
  };
  std::unique_ptr<T, Free> data_;
  std::size_t capacity_ = 0;
};

}  // namespace granary
