// still NODE PICTURE: shows one raw grey picture on an output node until it is told to end. An output of vivid repeats
// its last buffer, and its capture side shows it ("Loop Video"): a camera before a scene that stands still, which can
// be unplugged while this program runs.
#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <exception>
#include <fstream>
#include <iostream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

namespace {

constexpr unsigned kWidth = 640, kHeight = 480;

void Check(int result, const std::string& what) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), what);
}

void Show(const std::string& node, const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  const std::vector<char> picture{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  if (picture.size() != std::size_t{kWidth} * kHeight) throw std::runtime_error(file + ": wrong size");

  const int fd = open(node.c_str(), O_RDWR | O_CLOEXEC);
  Check(fd, node);
  v4l2_format format{};
  format.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
  Check(ioctl(fd, VIDIOC_G_FMT, &format), "VIDIOC_G_FMT");
  format.fmt.pix.width = kWidth;
  format.fmt.pix.height = kHeight;
  format.fmt.pix.pixelformat = V4L2_PIX_FMT_GREY;
  format.fmt.pix.field = V4L2_FIELD_NONE;
  format.fmt.pix.bytesperline = 0;
  Check(ioctl(fd, VIDIOC_S_FMT, &format), "VIDIOC_S_FMT");
  if (format.fmt.pix.width != kWidth || format.fmt.pix.height != kHeight || format.fmt.pix.bytesperline != kWidth) {
    throw std::runtime_error(node + ": takes no pictures of 640x480");
  }
  v4l2_requestbuffers request{};
  request.count = 3;
  request.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
  request.memory = V4L2_MEMORY_MMAP;
  Check(ioctl(fd, VIDIOC_REQBUFS, &request), "VIDIOC_REQBUFS");
  for (unsigned i = 0; i < request.count; ++i) {
    v4l2_buffer buffer{};
    buffer.type = request.type;
    buffer.memory = request.memory;
    buffer.index = i;
    Check(ioctl(fd, VIDIOC_QUERYBUF, &buffer), "VIDIOC_QUERYBUF");
    void* memory = mmap(nullptr, buffer.length, PROT_READ | PROT_WRITE, MAP_SHARED, fd, buffer.m.offset);
    if (memory == MAP_FAILED) Check(-1, "mmap");
    std::copy(picture.begin(), picture.end(), static_cast<char*>(memory));
    buffer.bytesused = kWidth * kHeight;
    buffer.field = V4L2_FIELD_NONE;
    Check(ioctl(fd, VIDIOC_QBUF, &buffer), "VIDIOC_QBUF");
  }
  int type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
  Check(ioctl(fd, VIDIOC_STREAMON, &type), "VIDIOC_STREAMON");
  std::cout << "showing " << file << " on " << node << std::endl;
  for (;;) pause();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::cerr << "usage: still NODE PICTURE\n";
    return 2;
  }
  try {
    Show(argv[1], argv[2]);
  } catch (const std::exception& error) {
    std::cerr << "still: " << error.what() << '\n';
  }
  return 1;
}
