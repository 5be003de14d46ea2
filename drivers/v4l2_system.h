// The system calls a V4L2 node is used with: the seam where tests put a node of their own.
#pragma once

#include <poll.h>
#include <sys/types.h>

#include <chrono>
#include <cstddef>

#include "pipeline/types/frame.h"

namespace granary {

/// Each as the system call of its name: -1 (Map: MAP_FAILED) and errno on failure. One node and its thread at a time.
class V4l2System {
 public:
  virtual ~V4l2System() = default;
  virtual int Open(const char* path, int flags) = 0;
  virtual int Close(int fd) = 0;
  virtual int Ioctl(int fd, unsigned long request, void* argument) = 0;
  /// Readable and writable, shared.
  virtual void* Map(std::size_t bytes, int fd, off_t offset) = 0;
  virtual int Unmap(void* address, std::size_t bytes) = 0;
  virtual int Poll(pollfd* fds, nfds_t count, int timeout_ms) = 0;
  /// CLOCK_MONOTONIC, which stamps the frames.
  virtual std::chrono::nanoseconds Monotonic() = 0;
  virtual UtcTime Utc() = 0;
};

/// The kernel's.
[[nodiscard]] V4l2System& KernelV4l2();

}  // namespace granary
