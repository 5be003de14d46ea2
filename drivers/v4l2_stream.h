// The buffers of a V4L2 node: asked for, mapped, filled by the driver, and given back.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "drivers/v4l2_node.h"

namespace granary {

/// How the driver stamps its frames.
enum class StampSource : std::uint8_t { kUnknown, kStartOfExposure, kEndOfFrame };

/// A buffer that the driver has filled. Ours until it is given back.
struct V4l2Buffer {
  std::uint32_t index = 0;
  std::span<const std::byte> bytes;  ///< those filled; empty when the driver claims more than the buffer holds
  bool spoilt = false;               ///< the driver says so
  std::uint32_t sequence = 0;
  StampSource stamp_source = StampSource::kUnknown;
  std::chrono::nanoseconds stamp{};  ///< CLOCK_MONOTONIC; means nothing where the source is unknown
};

/// Buffers of one node, mapped from construction to destruction. One thread, but for Interrupt. Errors of the node are
/// DeviceError.
class V4l2Stream {
 public:
  V4l2Stream(const V4l2Node& node, unsigned count);
  ~V4l2Stream();
  V4l2Stream(const V4l2Stream&) = delete;
  V4l2Stream& operator=(const V4l2Stream&) = delete;

  [[nodiscard]] bool on() const { return on_; }
  [[nodiscard]] std::size_t count() const { return maps_.size(); }
  /// Hands every buffer to the driver, empty, and starts it.
  void Start();
  /// Also what had been filled is gone. Never throws: a node that is gone has stopped.
  void Stop() noexcept;
  /// The oldest filled buffer, without waiting; empty when none is.
  [[nodiscard]] std::optional<V4l2Buffer> TryTake() const;
  /// Waits for it, at most until CLOCK_MONOTONIC is `deadline`. @return empty when none came in time
  /// @throws DeviceError: also kFrameMissing when interrupted
  [[nodiscard]] std::optional<V4l2Buffer> Take(std::chrono::nanoseconds deadline) const;
  void GiveBack(const V4l2Buffer& buffer) const;

  /// Ends a Take that waits, or the next one. Any thread.
  void Interrupt() noexcept;
  void ForgetInterrupt() noexcept;

 private:
  struct Map {
    void* address;
    std::size_t bytes;
  };
  void MapBuffers(unsigned count);
  void Release() noexcept;

  const V4l2Node& node_;
  int wake_ = -1;  ///< eventfd
  std::vector<Map> maps_;
  bool on_ = false;
};

}  // namespace granary
