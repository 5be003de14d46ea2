// A DQBUF that blocks never comes back from a camera that was pulled. So the node is opened without blocking, and all
// waiting is done in poll, which an eventfd can end as well.
#include "drivers/v4l2_stream.h"

#include <linux/videodev2.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <string>
#include <system_error>

#include <spdlog/spdlog.h>

namespace granary {
namespace {

// With fewer the driver has nowhere to write while one is read.
constexpr unsigned kFewestBuffers = 2;
// A stamp farther ahead of the clock is of another one, whatever the flag says: uvcvideo can be told to use UTC. A
// little ahead are drivers that calculate it, as vivid does.
constexpr std::chrono::seconds kStampAhead{1};

v4l2_buffer EmptyBuffer(std::uint32_t index) {
  v4l2_buffer buffer{};
  buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  buffer.memory = V4L2_MEMORY_MMAP;
  buffer.index = index;
  return buffer;
}

}  // namespace

V4l2Stream::V4l2Stream(const V4l2Node& node, unsigned count)
    : node_(node), wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (wake_ < 0) throw node_.ErrorOf(errno, "make an eventfd");
  try {
    MapBuffers(count);
  } catch (...) {
    Release();
    throw;
  }
}

V4l2Stream::~V4l2Stream() {
  Stop();
  Release();
}

void V4l2Stream::MapBuffers(unsigned count) {
  v4l2_requestbuffers request{};
  request.count = count;
  request.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  request.memory = V4L2_MEMORY_MMAP;
  node_.Do(VIDIOC_REQBUFS, &request, "ask for buffers");
  if (request.count < kFewestBuffers) {
    throw node_.Refused("ask for buffers", "the driver gives " + std::to_string(request.count) + ", at least " +
                                               std::to_string(kFewestBuffers) + " are needed");
  }
  for (std::uint32_t index = 0; index < request.count; ++index) {
    v4l2_buffer buffer = EmptyBuffer(index);
    node_.Do(VIDIOC_QUERYBUF, &buffer, "ask for a buffer's place");
    void* const address = node_.system().Map(buffer.length, node_.fd(), static_cast<off_t>(buffer.m.offset));
    if (address == MAP_FAILED) throw node_.ErrorOf(errno, "map a buffer");
    maps_.push_back({address, buffer.length});
  }
}

void V4l2Stream::Release() noexcept {
  for (const Map& map : maps_) node_.system().Unmap(map.address, map.bytes);
  maps_.clear();
  ::close(wake_);
}

void V4l2Stream::Start() {
  // What a start that failed half-way had queued comes back first.
  Stop();
  for (std::uint32_t index = 0; index < maps_.size(); ++index) {
    v4l2_buffer buffer = EmptyBuffer(index);
    node_.Do(VIDIOC_QBUF, &buffer, "queue a buffer");
  }
  int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  node_.Do(VIDIOC_STREAMON, &type, "start streaming");
  on_ = true;
}

void V4l2Stream::Stop() noexcept {
  on_ = false;
  int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  const int error = node_.Try(VIDIOC_STREAMOFF, &type);
  // EINVAL: it was not streaming.
  if (error == 0 || error == EINVAL) return;
  try {
    spdlog::debug("{}: stop streaming: {}", node_.path(), std::generic_category().message(error));
  } catch (...) {  // no memory for the message: there is nobody left to tell
  }
}

std::optional<V4l2Buffer> V4l2Stream::TryTake() const {
  v4l2_buffer buffer = EmptyBuffer(0);
  const int error = node_.Try(VIDIOC_DQBUF, &buffer);
  if (error == EAGAIN) return std::nullopt;
  if (error != 0) throw node_.ErrorOf(error, "take a frame");
  V4l2Buffer taken;
  taken.index = buffer.index;
  const Map& map = maps_.at(buffer.index);
  if (buffer.bytesused <= map.bytes) taken.bytes = {static_cast<const std::byte*>(map.address), buffer.bytesused};
  taken.spoilt = (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0;
  taken.sequence = buffer.sequence;
  if ((buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC) {
    taken.stamp = std::chrono::seconds(buffer.timestamp.tv_sec) + std::chrono::microseconds(buffer.timestamp.tv_usec);
    const auto source = buffer.flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK;
    if (taken.stamp > node_.system().Monotonic() + kStampAhead) return taken;
    if (source == V4L2_BUF_FLAG_TSTAMP_SRC_EOF) taken.stamp_source = StampSource::kEndOfFrame;
    if (source == V4L2_BUF_FLAG_TSTAMP_SRC_SOE) taken.stamp_source = StampSource::kStartOfExposure;
  }
  return taken;
}

std::optional<V4l2Buffer> V4l2Stream::Take(std::chrono::nanoseconds deadline) const {
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - node_.system().Monotonic());
    if (left.count() <= 0) return std::nullopt;
    std::array<pollfd, 2> fds{pollfd{node_.fd(), POLLIN, 0}, pollfd{wake_, POLLIN, 0}};
    const int wait_ms = static_cast<int>(std::min<std::chrono::milliseconds::rep>(left.count(), 60'000));
    const int ready = node_.system().Poll(fds.data(), fds.size(), wait_ms);
    if (ready < 0 && errno != EINTR) throw node_.ErrorOf(errno, "wait for a frame");
    if (ready <= 0) continue;
    if (fds[1].revents != 0) throw DeviceError(Reason::kFrameMissing, node_.path(), "grab", "interrupted");
    // A node that was pulled reports an error here, and says which when asked for a frame.
    if (auto buffer = TryTake()) return buffer;
    if ((fds[0].revents & (POLLERR | POLLHUP | POLLNVAL)) != 0) {
      throw DeviceError(Reason::kCameraUnavailable, node_.path(), "wait for a frame",
                        "the node reports an error; was it unplugged?");
    }
  }
}

void V4l2Stream::GiveBack(const V4l2Buffer& buffer) const {
  v4l2_buffer back = EmptyBuffer(buffer.index);
  node_.Do(VIDIOC_QBUF, &back, "give a buffer back");
}

void V4l2Stream::Interrupt() noexcept { ::eventfd_write(wake_, 1); }

void V4l2Stream::ForgetInterrupt() noexcept {
  eventfd_t count = 0;
  ::eventfd_read(wake_, &count);
}

}  // namespace granary
