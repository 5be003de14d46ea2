// feeder FOLDER LEFT RIGHT LINE [--triggered]: a pair of cameras before the simulated bin. Plays the pictures of FOLDER
// into two v4l2loopback nodes, 16 pairs a second: lit ones when the GPIO line, whose sysfs `value` file is LINE, was
// high during the whole exposure, else dark ones. With --triggered an exposure begins when the line rises, and only
// then. Each exposure's begin and end go into the kernel's trace, in one order with the line's own edges.
#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;
using Picture = std::vector<char>;
using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr int kWidth = 640, kHeight = 480;
constexpr std::size_t kNoises = 3;
constexpr milliseconds kPeriod{60};
constexpr milliseconds kExposure{8};
constexpr microseconds kLook{500};  // between two looks at the line

int Check(int result, const std::string& what) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), what);
  return result;
}

Picture ReadPicture(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  Picture picture{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  if (picture.size() != std::size_t{kWidth} * kHeight) throw std::runtime_error(file.string() + ": wrong size");
  return picture;
}

/// One camera: its node and what it sees.
class Eye {
 public:
  Eye(const std::filesystem::path& folder, const std::string& side, const std::string& node)
      : node_(node), fd_(Check(open(node.c_str(), O_RDWR | O_CLOEXEC), node)) {
    v4l2_format format{};
    format.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    format.fmt.pix.width = kWidth;
    format.fmt.pix.height = kHeight;
    format.fmt.pix.pixelformat = V4L2_PIX_FMT_GREY;
    format.fmt.pix.field = V4L2_FIELD_NONE;
    format.fmt.pix.bytesperline = kWidth;
    format.fmt.pix.sizeimage = kWidth * kHeight;
    Check(ioctl(fd_, VIDIOC_S_FMT, &format), node + ": VIDIOC_S_FMT");
    for (std::size_t i = 0; i < kNoises; ++i) {
      lit_[i] = ReadPicture(folder / (side + "-lit-" + std::to_string(i) + ".grey"));
      dark_[i] = ReadPicture(folder / (side + "-dark-" + std::to_string(i) + ".grey"));
    }
  }
  void Show(bool lit, std::uint64_t number) const {
    const Picture& picture = (lit ? lit_ : dark_)[number % kNoises];
    if (Check(static_cast<int>(write(fd_, picture.data(), picture.size())), node_) != kWidth * kHeight) {
      throw std::runtime_error(node_ + ": took a part of the picture");
    }
  }

 private:
  std::string node_;
  int fd_;
  std::array<Picture, kNoises> lit_, dark_;
};

class Line {
 public:
  explicit Line(const std::string& file) : fd_(Check(open(file.c_str(), O_RDONLY | O_CLOEXEC), file)) {}
  bool IsHigh() const {
    char value = 0;
    Check(static_cast<int>(pread(fd_, &value, 1, 0)), "the line's value");
    return value == '1';
  }

 private:
  int fd_;
};

class Trace {
 public:
  Trace() : fd_(Check(open("/sys/kernel/tracing/trace_marker", O_WRONLY | O_CLOEXEC), "trace_marker")) {}
  void Write(const std::string& words) const {
    while (write(fd_, words.data(), words.size()) < 0) {
      // What the kernel says while somebody empties the trace.
      if (errno != EBADF) throw std::system_error(errno, std::generic_category(), "trace_marker");
      std::this_thread::sleep_for(kLook);
    }
  }

 private:
  int fd_;
};

/// The line is looked at first after the "begins" and last before the "ends" is written down, so that in the trace a
/// lit exposure lies between the line's edges however the program is held up.
bool Expose(const Line& line, const Trace& trace, std::uint64_t number) {
  bool lit = line.IsHigh();
  trace.Write("exposure " + std::to_string(number) + " begins");
  for (const auto end = Clock::now() + kExposure; Clock::now() < end;) {
    std::this_thread::sleep_for(kLook);
    lit = lit && line.IsHigh();
  }
  trace.Write("exposure " + std::to_string(number) + " ends");
  lit = lit && line.IsHigh();
  trace.Write("exposure " + std::to_string(number) + (lit ? " was lit" : " was dark"));
  return lit;
}

void Feed(const std::filesystem::path& folder, const std::string& left, const std::string& right,
          const std::string& value_file, bool triggered) {
  const Eye left_eye(folder, "left", left), right_eye(folder, "right", right);
  const Line line(value_file);
  const Trace trace;
  // A node has a format to capture, and tells it, only after the first picture.
  left_eye.Show(false, 0);
  right_eye.Show(false, 0);
  std::cout << "feeding " << folder.string() << std::endl;
  auto next = Clock::now();
  for (std::uint64_t number = 1;; ++number) {
    if (triggered) {
      while (line.IsHigh()) std::this_thread::sleep_for(kLook);
      while (!line.IsHigh()) std::this_thread::sleep_for(kLook);
    } else {
      next = std::max(next + kPeriod, Clock::now());
      std::this_thread::sleep_until(next);
    }
    const bool lit = Expose(line, trace, number);
    left_eye.Show(lit, number);
    right_eye.Show(lit, number);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool triggered = argc == 6 && std::string_view(argv[5]) == "--triggered";
  if (argc != 5 && !triggered) {
    std::cerr << "usage: feeder FOLDER LEFT RIGHT LINE [--triggered]\n";
    return 2;
  }
  try {
    Feed(argv[1], argv[2], argv[3], argv[4], triggered);
  } catch (const std::exception& error) {
    std::cerr << "feeder: " << error.what() << '\n';
  }
  return 1;
}
