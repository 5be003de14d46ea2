// The newest value of something, handed from one thread to others.
#pragma once

#include <memory>
#include <mutex>
#include <utility>

namespace granary {

/// One writer or several, any number of readers; a reader sees one whole value.
template <typename T>
class Latest {
 public:
  explicit Latest(T value) : value_(std::make_shared<const T>(std::move(value))) {}
  void Set(T value) {
    auto next = std::make_shared<const T>(std::move(value));
    const std::scoped_lock lock(mutex_);
    value_.swap(next);
  }
  [[nodiscard]] std::shared_ptr<const T> Get() const {
    const std::scoped_lock lock(mutex_);
    return value_;
  }

 private:
  mutable std::mutex mutex_;
  std::shared_ptr<const T> value_;
};

}  // namespace granary
