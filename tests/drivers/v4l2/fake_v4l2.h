// V4L2 nodes without a kernel: they keep to the kernel's rules, count what they hand out, and fail on request.
#pragma once

#include <linux/videodev2.h>

#include <chrono>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <opencv2/core/types.hpp>

#include "drivers/v4l2_system.h"

namespace granary {

struct FakeControl {
  std::string name;
  std::uint32_t type = V4L2_CTRL_TYPE_INTEGER;
  std::int64_t minimum = 0, maximum = 1, step = 1, value = 0;
  std::uint32_t flags = 0;
  std::map<std::int64_t, std::string> menu{};  ///< of an integer menu: numbers
  std::string text{};
  bool stuck = false;  ///< takes a value and keeps its own
};

struct FakeFormat {
  std::string name;
  std::vector<cv::Size> sizes;
};

/// A camera behind a node. Set up by the test, used by the code under test through FakeV4l2.
struct FakeNode {
  std::string driver = "fake", card = "Fake camera", bus = "usb-1";
  std::uint32_t caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
  std::vector<FakeFormat> formats{{"GREY", {{8, 4}, {16, 8}}}};
  std::map<std::uint32_t, FakeControl> controls;
  std::uint32_t stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_EOF;
  bool can_crop = false;
  std::uint32_t interval_ms = 33;  ///< as it says; 0: does not
  std::uint32_t row_padding = 0;   ///< bytes behind each row
  unsigned most_buffers = 32;
  bool interlaced = false;
  bool counts_on = false;              ///< the sequence goes on over STREAMOFF
  bool keeps_last = false;             ///< its last picture comes again when a stream starts
  std::map<unsigned long, int> fails;  ///< errno of an ioctl
  /// What happens while somebody waits: one at a time, 1 ms apart.
  std::deque<std::function<void(FakeNode&)>> to_come;
  std::uint32_t runs_free_ms = 0;  ///< a frame each so many ms; 0: only those of to_come

  /// A frame ends now: into a buffer if the driver has one, else it is lost and only counted.
  void Send(const std::vector<std::uint8_t>& bytes, std::uint32_t flags = 0);
  /// One of the set size, all of one grey.
  void SendGrey(int grey, std::uint32_t flags = 0);
  void Unplug() { unplugged = true; }
  /// The picture in bytes as the set format has it, GREY or Y16.
  [[nodiscard]] std::vector<std::uint8_t> Grey(int grey) const;

  struct Buffer {
    std::shared_ptr<std::vector<std::uint8_t>> memory;
    bool queued = false;
    v4l2_buffer filled{};
  };
  bool unplugged = false;
  int owner = -1;  ///< the descriptor that has buffers; other programs' are 1
  bool streaming = false;
  std::uint32_t sequence = 0;
  int starts = 0;
  std::vector<Buffer> buffers;
  std::deque<std::uint32_t> queued, done;
  std::vector<std::uint8_t> last;
  v4l2_pix_format pix{};
  v4l2_rect crop{0, 0, 16, 8};
  const std::chrono::nanoseconds* clock = nullptr;
};

class FakeV4l2 final : public V4l2System {
 public:
  /// A node at `path`; a second one there takes the place of the first.
  std::shared_ptr<FakeNode> Plug(const std::filesystem::path& path);

  int Open(const char* path, int flags) override;
  int Close(int fd) override;
  int Ioctl(int fd, unsigned long request, void* argument) override;
  void* Map(std::size_t bytes, int fd, off_t offset) override;
  int Unmap(void* address, std::size_t bytes) override;
  int Poll(pollfd* fds, nfds_t count, int timeout_ms) override;
  std::chrono::nanoseconds Monotonic() override { return now; }
  UtcTime Utc() override { return UtcTime(std::chrono::seconds(1'800'000'000)) + now; }

  std::chrono::nanoseconds now{std::chrono::seconds(100)};
  std::map<std::string, int> open_fails;   ///< errno by path
  std::function<void()> before_real_wait;  ///< set: a Poll without frames waits for the other descriptors in earnest
  [[nodiscard]] std::size_t open_fds() const { return open_.size(); }
  [[nodiscard]] std::size_t mappings() const { return maps_.size(); }

 private:
  struct Opened {
    std::shared_ptr<FakeNode> node;
    int flags;
  };
  int next_fd_ = 1000;
  std::map<std::string, std::shared_ptr<FakeNode>> nodes_;
  std::map<int, Opened> open_;
  std::map<void*, std::shared_ptr<std::vector<std::uint8_t>>> maps_;
};

}  // namespace granary
