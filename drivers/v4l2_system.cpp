// Every call goes straight to the kernel.
#include "drivers/v4l2_system.h"

#include <fcntl.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

namespace granary {
namespace {

class Kernel final : public V4l2System {
 public:
  int Open(const char* path, int flags) override { return ::open(path, flags); }
  int Close(int fd) override { return ::close(fd); }
  int Ioctl(int fd, unsigned long request, void* argument) override { return ::ioctl(fd, request, argument); }
  void* Map(std::size_t bytes, int fd, off_t offset) override {
    return ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, offset);
  }
  int Unmap(void* address, std::size_t bytes) override { return ::munmap(address, bytes); }
  int Poll(pollfd* fds, nfds_t count, int timeout_ms) override { return ::poll(fds, count, timeout_ms); }
  std::chrono::nanoseconds Monotonic() override {
    // libstdc++'s steady clock is CLOCK_MONOTONIC.
    return std::chrono::steady_clock::now().time_since_epoch();
  }
  UtcTime Utc() override { return std::chrono::system_clock::now(); }
};

}  // namespace

V4l2System& KernelV4l2() {
  static Kernel kernel;
  return kernel;
}

}  // namespace granary
