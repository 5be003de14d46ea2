// The rules are those of the kernel's documentation and of videobuf2, which nearly all drivers are built on.
#include "tests/drivers/v4l2/fake_v4l2.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include <gtest/gtest.h>

#include "drivers/pixel_formats.h"

namespace granary {
namespace {

std::uint32_t CodeOf(std::string name) {
  name.resize(4, ' ');
  return v4l2_fourcc(name[0], name[1], name[2], name[3]);
}

std::string NameOf(std::uint32_t code) {
  std::string name;
  for (int i = 0; i < 4; ++i) name += static_cast<char>(code >> 8 * i);
  name.erase(name.find_last_not_of(' ') + 1);
  return name;
}

template <std::size_t N>
void Copy(const std::string& text, std::uint8_t (&to)[N]) {
  std::memcpy(to, text.data(), std::min(text.size(), N - 1));
}

/// As a driver makes of a wish what it can do.
void Adjust(const FakeNode& node, v4l2_pix_format& pix) {
  auto format = std::find_if(node.formats.begin(), node.formats.end(),
                             [&](const auto& f) { return CodeOf(f.name) == pix.pixelformat; });
  if (format == node.formats.end()) format = node.formats.begin();
  pix.pixelformat = CodeOf(format->name);
  const cv::Size wish(static_cast<int>(pix.width), static_cast<int>(pix.height));
  const bool there = std::find(format->sizes.begin(), format->sizes.end(), wish) != format->sizes.end();
  const cv::Size size = there ? wish : format->sizes.front();
  pix.width = static_cast<__u32>(size.width);
  pix.height = static_cast<__u32>(size.height);
  pix.field = node.interlaced ? V4L2_FIELD_INTERLACED : V4L2_FIELD_NONE;
  const auto layout = LayoutOfV4l2(format->name);
  const auto row = layout ? RowBytesOf(*layout, size.width) : 0;
  pix.bytesperline = row == 0 ? 0 : static_cast<__u32>(row) + node.row_padding;
  pix.sizeimage = row == 0 ? 4096 : pix.bytesperline * pix.height;
}

int Capability(const FakeNode& node, v4l2_capability& capability) {
  Copy(node.driver, capability.driver);
  Copy(node.card, capability.card);
  Copy(node.bus, capability.bus_info);
  // The device as a whole has a metadata node as well.
  capability.capabilities = node.caps | V4L2_CAP_DEVICE_CAPS | V4L2_CAP_META_CAPTURE | V4L2_CAP_VIDEO_CAPTURE;
  capability.device_caps = node.caps;
  return 0;
}

int EnumFormat(const FakeNode& node, v4l2_fmtdesc& format) {
  if (format.type != V4L2_BUF_TYPE_VIDEO_CAPTURE || format.index >= node.formats.size()) return EINVAL;
  format.pixelformat = CodeOf(node.formats[format.index].name);
  return 0;
}

int EnumSize(const FakeNode& node, v4l2_frmsizeenum& size) {
  for (const auto& format : node.formats) {
    if (CodeOf(format.name) != size.pixel_format) continue;
    if (size.index >= format.sizes.size()) return EINVAL;
    size.type = V4L2_FRMSIZE_TYPE_DISCRETE;
    size.discrete = {static_cast<__u32>(format.sizes[size.index].width),
                     static_cast<__u32>(format.sizes[size.index].height)};
    return 0;
  }
  return EINVAL;
}

int SetFormat(FakeNode& node, v4l2_pix_format& pix) {
  if (node.owner != -1) return EBUSY;
  Adjust(node, pix);
  node.pix = pix;
  return 0;
}

int Selection(FakeNode& node, v4l2_selection& selection, bool set) {
  if (!node.can_crop) return ENOTTY;
  if (selection.target == V4L2_SEL_TGT_CROP_DEFAULT) {
    selection.r = {0, 0, 16, 8};
    return set ? EINVAL : 0;
  }
  // The sensor cuts at even places only.
  if (set) node.crop = {selection.r.left & ~1, selection.r.top & ~1, selection.r.width, selection.r.height};
  selection.r = node.crop;
  return 0;
}

int Parameters(const FakeNode& node, v4l2_streamparm& parameters) {
  if (node.interval_ms == 0) return ENOTTY;
  parameters.parm.capture.timeperframe = {node.interval_ms, 1000};
  return 0;
}

int QueryControl(const FakeNode& node, v4l2_query_ext_ctrl& query) {
  const bool next = (query.id & V4L2_CTRL_FLAG_NEXT_CTRL) != 0;
  const std::uint32_t id = query.id & ~V4L2_CTRL_FLAG_NEXT_CTRL;
  const auto found = next ? node.controls.upper_bound(id) : node.controls.find(id);
  if (found == node.controls.end()) return EINVAL;
  const FakeControl& control = found->second;
  query = {};
  query.id = found->first;
  query.type = control.type;
  std::memcpy(query.name, control.name.data(), std::min<std::size_t>(control.name.size(), 31));
  query.minimum = control.minimum;
  query.maximum = control.maximum;
  query.step = static_cast<__u64>(control.step);
  query.flags = control.flags;
  query.elem_size = control.type == V4L2_CTRL_TYPE_STRING ? static_cast<__u32>(control.maximum + 1) : 4;
  return 0;
}

int QueryMenu(const FakeNode& node, v4l2_querymenu& query) {
  const auto control = node.controls.find(query.id);
  if (control == node.controls.end()) return EINVAL;
  const auto entry = control->second.menu.find(query.index);
  if (entry == control->second.menu.end()) return EINVAL;
  if (control->second.type == V4L2_CTRL_TYPE_INTEGER_MENU) {
    query.value = std::stoll(entry->second);
  } else {
    std::memset(query.name, 0, sizeof(query.name));
    std::memcpy(query.name, entry->second.data(), std::min<std::size_t>(entry->second.size(), 31));
  }
  return 0;
}

int Transfer(FakeNode& node, v4l2_ext_controls& all, bool set) {
  if (all.count != 1) return EINVAL;
  v4l2_ext_control& value = all.controls[0];
  const auto found = node.controls.find(value.id);
  if (found == node.controls.end()) return EINVAL;
  FakeControl& control = found->second;
  if (set && (control.flags & V4L2_CTRL_FLAG_READ_ONLY) != 0) return EACCES;
  if (control.type == V4L2_CTRL_TYPE_STRING) {
    if (set) {
      if (std::strlen(value.string) > static_cast<std::size_t>(control.maximum)) return ERANGE;
      control.text = value.string;
    } else {
      std::memcpy(value.string, control.text.c_str(), control.text.size() + 1);
    }
    return 0;
  }
  const bool wide = control.type == V4L2_CTRL_TYPE_INTEGER64;
  if (!set) {
    if (wide) {
      value.value64 = control.value;
    } else {
      value.value = static_cast<__s32>(control.value);
    }
    return 0;
  }
  const std::int64_t wish = wide ? std::int64_t{value.value64} : std::int64_t{value.value};
  if (control.type == V4L2_CTRL_TYPE_BUTTON) return 0;
  if (control.type != V4L2_CTRL_TYPE_BITMASK && (wish < control.minimum || wish > control.maximum)) return ERANGE;
  if (!control.menu.empty() && control.menu.count(wish) == 0) return EINVAL;
  if (!control.stuck) control.value = wish;
  return 0;
}

int RequestBuffers(FakeNode& node, int fd, v4l2_requestbuffers& request) {
  if (node.owner != -1 && node.owner != fd) return EBUSY;
  if (node.streaming) return EBUSY;
  request.count = std::min(request.count, node.most_buffers);
  node.owner = request.count == 0 ? -1 : fd;
  node.buffers.assign(request.count, {});
  for (auto& buffer : node.buffers) buffer.memory = std::make_shared<std::vector<std::uint8_t>>(node.pix.sizeimage);
  node.queued.clear();
  node.done.clear();
  return 0;
}

int QueryBuffer(const FakeNode& node, v4l2_buffer& buffer) {
  if (buffer.index >= node.buffers.size()) return EINVAL;
  buffer.length = node.pix.sizeimage;
  buffer.m.offset = buffer.index << 12;
  return 0;
}

int Queue(FakeNode& node, int fd, const v4l2_buffer& wish) {
  if (node.owner != fd || wish.index >= node.buffers.size()) return EINVAL;
  auto& buffer = node.buffers[wish.index];
  const bool done = std::find(node.done.begin(), node.done.end(), wish.index) != node.done.end();
  if (buffer.queued || done) return EINVAL;
  buffer.queued = true;
  // Whoever still reads it sees that it is not theirs any more.
  std::fill(buffer.memory->begin(), buffer.memory->end(), std::uint8_t{0xDD});
  node.queued.push_back(wish.index);
  return 0;
}

int Dequeue(FakeNode& node, int fd, int flags, v4l2_buffer& buffer) {
  if (node.owner != fd || !node.streaming) return EINVAL;
  if (node.done.empty()) {
    if ((flags & O_NONBLOCK) == 0) ADD_FAILURE() << "DQBUF would block for ever";
    return EAGAIN;
  }
  buffer = node.buffers[node.done.front()].filled;
  node.done.pop_front();
  return 0;
}

int Start(FakeNode& node, int fd) {
  if (node.owner != -1 && node.owner != fd) return EBUSY;
  if (node.owner != fd || node.queued.empty()) return EINVAL;
  node.streaming = true;
  ++node.starts;
  if (!node.counts_on) node.sequence = 0;
  if (node.keeps_last && !node.last.empty()) node.Send(node.last);
  return 0;
}

int Stop(FakeNode& node, int fd) {
  if (node.owner != fd) return EBUSY;
  node.streaming = false;
  node.queued.clear();
  node.done.clear();
  for (auto& buffer : node.buffers) buffer.queued = false;
  return 0;
}

int Call(FakeNode& node, int fd, int flags, unsigned long request, void* argument) {
  if (node.unplugged) return ENODEV;
  if (const auto fail = node.fails.find(request); fail != node.fails.end()) return fail->second;
  switch (request) {
    case VIDIOC_QUERYCAP:
      return Capability(node, *static_cast<v4l2_capability*>(argument));
    case VIDIOC_ENUM_FMT:
      return EnumFormat(node, *static_cast<v4l2_fmtdesc*>(argument));
    case VIDIOC_ENUM_FRAMESIZES:
      return EnumSize(node, *static_cast<v4l2_frmsizeenum*>(argument));
    case VIDIOC_G_FMT:
      static_cast<v4l2_format*>(argument)->fmt.pix = node.pix;
      return 0;
    case VIDIOC_S_FMT:
      return SetFormat(node, static_cast<v4l2_format*>(argument)->fmt.pix);
    case VIDIOC_G_SELECTION:
      return Selection(node, *static_cast<v4l2_selection*>(argument), false);
    case VIDIOC_S_SELECTION:
      return Selection(node, *static_cast<v4l2_selection*>(argument), true);
    case VIDIOC_G_PARM:
      return Parameters(node, *static_cast<v4l2_streamparm*>(argument));
    case VIDIOC_QUERY_EXT_CTRL:
      return QueryControl(node, *static_cast<v4l2_query_ext_ctrl*>(argument));
    case VIDIOC_QUERYMENU:
      return QueryMenu(node, *static_cast<v4l2_querymenu*>(argument));
    case VIDIOC_S_EXT_CTRLS:
      return Transfer(node, *static_cast<v4l2_ext_controls*>(argument), true);
    case VIDIOC_G_EXT_CTRLS:
      return Transfer(node, *static_cast<v4l2_ext_controls*>(argument), false);
    case VIDIOC_REQBUFS:
      return RequestBuffers(node, fd, *static_cast<v4l2_requestbuffers*>(argument));
    case VIDIOC_QUERYBUF:
      return QueryBuffer(node, *static_cast<v4l2_buffer*>(argument));
    case VIDIOC_QBUF:
      return Queue(node, fd, *static_cast<v4l2_buffer*>(argument));
    case VIDIOC_DQBUF:
      return Dequeue(node, fd, flags, *static_cast<v4l2_buffer*>(argument));
    case VIDIOC_STREAMON:
      return Start(node, fd);
    case VIDIOC_STREAMOFF:
      return Stop(node, fd);
    default:
      return ENOTTY;
  }
}

int Fail(int error) {
  errno = error;
  return -1;
}

}  // namespace

void FakeNode::Send(const std::vector<std::uint8_t>& bytes, std::uint32_t flags) {
  if (!streaming || unplugged) return;
  last = bytes;
  const std::uint32_t number = sequence++;
  if (queued.empty()) return;
  const std::uint32_t index = queued.front();
  queued.pop_front();
  Buffer& buffer = buffers.at(index);
  buffer.queued = false;
  std::copy_n(bytes.begin(), std::min(bytes.size(), buffer.memory->size()), buffer.memory->begin());
  v4l2_buffer& filled = buffer.filled;
  filled = {};
  filled.index = index;
  filled.bytesused = static_cast<__u32>(bytes.size());
  filled.flags = flags | stamp_flags;
  filled.sequence = number;
  const auto us = std::chrono::duration_cast<std::chrono::microseconds>(*clock).count();
  filled.timestamp.tv_sec = us / 1'000'000;
  filled.timestamp.tv_usec = us % 1'000'000;
  done.push_back(index);
}

std::vector<std::uint8_t> FakeNode::Grey(int grey) const {
  std::vector<std::uint8_t> bytes(pix.sizeimage, static_cast<std::uint8_t>(grey));
  if (NameOf(pix.pixelformat)[0] == 'Y' && NameOf(pix.pixelformat) != "YUYV") {
    for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(grey >> 8 * (i % 2));
  }
  return bytes;
}

void FakeNode::SendGrey(int grey, std::uint32_t flags) { Send(Grey(grey), flags); }

std::shared_ptr<FakeNode> FakeV4l2::Plug(const std::filesystem::path& path) {
  auto node = std::make_shared<FakeNode>();
  node->clock = &now;
  nodes_[std::filesystem::weakly_canonical(path)] = node;
  return node;
}

int FakeV4l2::Open(const char* path, int flags) {
  const std::string place = std::filesystem::weakly_canonical(path);
  if (const auto fail = open_fails.find(place); fail != open_fails.end()) return Fail(fail->second);
  const auto found = nodes_.find(place);
  if (found == nodes_.end() || found->second->unplugged) return Fail(ENOENT);
  EXPECT_EQ(flags, O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (found->second->pix.pixelformat == 0) Adjust(*found->second, found->second->pix);
  open_[next_fd_] = {found->second, flags};
  return next_fd_++;
}

int FakeV4l2::Close(int fd) {
  const auto found = open_.find(fd);
  if (found == open_.end()) {
    ADD_FAILURE() << "closed what was not open";
    return Fail(EBADF);
  }
  FakeNode& node = *found->second.node;
  if (node.owner == fd) {
    node.streaming = false;
    node.owner = -1;
    node.buffers.clear();
    node.queued.clear();
    node.done.clear();
  }
  open_.erase(found);
  return 0;
}

int FakeV4l2::Ioctl(int fd, unsigned long request, void* argument) {
  const auto found = open_.find(fd);
  if (found == open_.end()) return Fail(EBADF);
  const int error = Call(*found->second.node, fd, found->second.flags, request, argument);
  return error == 0 ? 0 : Fail(error);
}

void* FakeV4l2::Map(std::size_t bytes, int fd, off_t offset) {
  const auto found = open_.find(fd);
  const auto index = static_cast<std::size_t>(offset >> 12);
  if (found == open_.end() || index >= found->second.node->buffers.size() ||
      found->second.node->buffers[index].memory->size() != bytes) {
    errno = EINVAL;
    return MAP_FAILED;
  }
  // As in the kernel, the memory lives as long as the mapping.
  const auto& memory = found->second.node->buffers[index].memory;
  maps_[memory->data()] = memory;
  return memory->data();
}

int FakeV4l2::Unmap(void* address, std::size_t bytes) {
  const auto found = maps_.find(address);
  if (found == maps_.end() || found->second->size() != bytes) {
    ADD_FAILURE() << "unmapped what was not mapped";
    return Fail(EINVAL);
  }
  maps_.erase(found);
  return 0;
}

int FakeV4l2::Poll(pollfd* fds, nfds_t count, int timeout_ms) {
  const auto end = now + std::chrono::milliseconds(timeout_ms);
  for (;;) {
    int ready = 0;
    FakeNode* node = nullptr;
    for (nfds_t i = 0; i < count; ++i) {
      fds[i].revents = 0;
      if (const auto found = open_.find(fds[i].fd); found != open_.end()) {
        node = found->second.node.get();
        if (node->unplugged) {
          fds[i].revents = POLLERR | POLLHUP;
        } else if (!node->streaming) {
          fds[i].revents = POLLERR;
        } else if (!node->done.empty()) {
          fds[i].revents = POLLIN;
        }
        if (fds[i].revents != 0) ++ready;
      } else {
        ready += ::poll(&fds[i], 1, 0);
      }
    }
    if (ready > 0) return ready;
    if (before_real_wait) {
      before_real_wait();
      for (nfds_t i = 0; i < count; ++i) {
        if (open_.count(fds[i].fd) == 0) return ::poll(&fds[i], 1, timeout_ms);
      }
    }
    if (node != nullptr && !node->to_come.empty()) {
      now += std::chrono::milliseconds(1);
      const auto next = node->to_come.front();
      node->to_come.pop_front();
      next(*node);
    } else if (node != nullptr && node->runs_free_ms > 0 &&
               now + std::chrono::milliseconds(node->runs_free_ms) <= end) {
      now += std::chrono::milliseconds(node->runs_free_ms);
      node->SendGrey(1);
    } else {
      now = end;
      return 0;
    }
  }
}

}  // namespace granary
