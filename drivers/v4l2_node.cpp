// A node may answer a wish with something else and call it success. So everything set is compared with what came back,
// and a difference ends in an error that lists what the node has.
#include "drivers/v4l2_node.h"

#include <fcntl.h>
#include <linux/videodev2.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <system_error>

namespace granary {
namespace {

// More bits first; what is packed or coded last.
constexpr std::array kPreferred{"Y16", "Y12", "Y10", "Y10P", "GREY", "YUYV", "MJPG"};

std::string NameOf(std::uint32_t four_characters) {
  std::string name;
  for (int shift = 0; shift < 32; shift += 8) name += static_cast<char>(four_characters >> shift & 0x7F);
  name.erase(name.find_last_not_of(' ') + 1);
  return name;
}

std::uint32_t CodeOf(std::string name) {
  name.resize(4, ' ');
  std::uint32_t code = 0;
  for (std::size_t i = 0; i < 4; ++i) code |= static_cast<std::uint32_t>(static_cast<unsigned char>(name[i])) << 8 * i;
  return code;
}

template <std::size_t N>
std::string Text(const std::uint8_t (&field)[N]) {
  return {reinterpret_cast<const char*>(field), strnlen(reinterpret_cast<const char*>(field), N)};
}

std::string Words(unsigned width, unsigned height) { return std::to_string(width) + "x" + std::to_string(height); }

std::string Joined(const std::vector<std::string>& words) {
  std::string line;
  for (const auto& word : words) line += (line.empty() ? "" : ", ") + word;
  return line.empty() ? "nothing" : line;
}

/// True for a driver that knows nothing of such a call.
bool IsUnknownCall(int error) { return error == ENOTTY || error == EINVAL || error == ENODATA; }

}  // namespace

V4l2Node::V4l2Node(V4l2System& system, const std::string& path)
    : system_(system), path_(path), fd_(system.Open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC)) {
  if (fd_ < 0) {
    const int error = errno;
    const Reason reason = error == EBUSY ? Reason::kCameraInUse : Reason::kCameraUnavailable;
    const std::string hint = error == EACCES ? "; the user has to be in the group video" : "";
    throw DeviceError(reason, path_, "open", std::generic_category().message(error) + hint);
  }
  try {
    CheckCapabilities();
  } catch (...) {
    system_.Close(fd_);
    throw;
  }
}

V4l2Node::~V4l2Node() { system_.Close(fd_); }

void V4l2Node::CheckCapabilities() {
  v4l2_capability capability{};
  Do(VIDIOC_QUERYCAP, &capability, "ask whether it is a V4L2 node");
  driver_ = Text(capability.driver);
  card_ = Text(capability.card);
  bus_ = Text(capability.bus_info);
  // device_caps is this node's own; the other field speaks of the whole device.
  const auto caps =
      (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0 ? capability.device_caps : capability.capabilities;
  if ((caps & V4L2_CAP_VIDEO_CAPTURE) == 0) {
    throw Refused("open", "id: the node captures no video (\"" + card_ +
                              "\"); must be a capture node that `granaryctl cameras` lists");
  }
  if ((caps & V4L2_CAP_STREAMING) == 0) throw Refused("open", "id: the node cannot stream into mapped buffers");
}

int V4l2Node::Try(unsigned long request, void* argument) const {
  for (;;) {
    if (system_.Ioctl(fd_, request, argument) != -1) return 0;
    if (errno != EINTR) return errno;
  }
}

void V4l2Node::Do(unsigned long request, void* argument, const std::string& operation) const {
  if (const int error = Try(request, argument)) throw ErrorOf(error, operation);
}

DeviceError V4l2Node::ErrorOf(int error, const std::string& operation) const {
  const std::string words = std::generic_category().message(error);
  switch (error) {
    case EBUSY:
      return {Reason::kCameraInUse, path_, operation, words + "; another program streams from it"};
    case ENODEV:
    case ENXIO:
    case EIO:
    case ESHUTDOWN:
    case EPROTO:
    case ETIMEDOUT:
    case EPIPE:
      return {Reason::kCameraUnavailable, path_, operation, words};
    case ENOSPC:
      return {Reason::kSettingRefused, path_, operation,
              words +
                  "; the USB bus has no bandwidth left: use another port, a smaller roi_px or pixel_format = "
                  "\"MJPG\""};
    default:
      return {Reason::kSettingRefused, path_, operation, words};
  }
}

DeviceError V4l2Node::Refused(const std::string& operation, const std::string& words) const {
  return {Reason::kSettingRefused, path_, operation, words};
}

std::vector<std::string> V4l2Node::FormatNames() const {
  std::vector<std::string> names;
  v4l2_fmtdesc format{};
  format.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  for (;; ++format.index) {
    const int error = Try(VIDIOC_ENUM_FMT, &format);
    if (IsUnknownCall(error)) return names;
    if (error != 0) throw ErrorOf(error, "list the formats");
    names.push_back(NameOf(format.pixelformat));
  }
}

std::string V4l2Node::SizesOf(const std::string& format) const {
  std::vector<std::string> sizes;
  v4l2_frmsizeenum size{};
  size.pixel_format = CodeOf(format);
  for (; Try(VIDIOC_ENUM_FRAMESIZES, &size) == 0; ++size.index) {
    if (size.type == V4L2_FRMSIZE_TYPE_DISCRETE) {
      sizes.push_back(Words(size.discrete.width, size.discrete.height));
      continue;
    }
    const auto& range = size.stepwise;
    sizes.push_back(Words(range.min_width, range.min_height) + " to " + Words(range.max_width, range.max_height) +
                    " in steps of " + Words(range.step_width, range.step_height));
    break;
  }
  return Joined(sizes);
}

std::string V4l2Node::Offers() const {
  std::vector<std::string> offers;
  for (const auto& name : FormatNames()) {
    if (LayoutOfV4l2(name)) offers.push_back(name + " (" + SizesOf(name) + ")");
  }
  return "the node offers " + Joined(offers);
}

bool V4l2Node::SetCrop(const std::vector<int>& roi_px) const {
  v4l2_selection crop{};
  crop.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  crop.target = V4L2_SEL_TGT_CROP_DEFAULT;
  int error = Try(VIDIOC_G_SELECTION, &crop);
  if (error == 0) {
    // Without a wish the whole picture: whoever used the node before may have cut it.
    if (!roi_px.empty()) {
      crop.r = {roi_px[0], roi_px[1], static_cast<__u32>(roi_px[2]), static_cast<__u32>(roi_px[3])};
    }
    crop.target = V4L2_SEL_TGT_CROP;
    error = Try(VIDIOC_S_SELECTION, &crop);
  }
  if (error == 0) return true;
  if (!IsUnknownCall(error)) throw ErrorOf(error, "set the crop");
  if (!roi_px.empty() && (roi_px[0] != 0 || roi_px[1] != 0)) {
    throw Refused("set the crop", "roi_px: the driver cannot cut out a part of the picture; x and y must be 0");
  }
  return false;
}

void V4l2Node::CheckCrop(const std::vector<int>& roi_px) const {
  v4l2_selection crop{};
  crop.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  crop.target = V4L2_SEL_TGT_CROP;
  Do(VIDIOC_G_SELECTION, &crop, "read the crop back");
  const std::vector<int> got{crop.r.left, crop.r.top, static_cast<int>(crop.r.width), static_cast<int>(crop.r.height)};
  if (got == roi_px) return;
  std::vector<std::string> numbers;
  for (const int number : got) numbers.push_back(std::to_string(number));
  throw Refused("set the crop", "roi_px: the driver makes of it [" + Joined(numbers) + "]");
}

V4l2Format V4l2Node::SetFormat(const CameraOptions& options, cv::Size size) const {
  const auto offered = FormatNames();
  std::string name = options.pixel_format;
  if (name.empty()) {
    const auto* const first = std::find_if(kPreferred.begin(), kPreferred.end(), [&](const char* candidate) {
      return std::find(offered.begin(), offered.end(), candidate) != offered.end();
    });
    if (first == kPreferred.end()) {
      throw Refused("set the format", "pixel_format: of the node's formats (" + Joined(offered) +
                                          ") this program reads none; it reads Y16, Y14, Y12, Y10, Y10P, GREY, "
                                          "YUYV and MJPG");
    }
    name = *first;
  }
  const auto layout = LayoutOfV4l2(name);
  if (!layout) {
    throw Refused("set the format",
                  "pixel_format: \"" + name + "\" is none that this program reads from V4L2 nodes; " + Offers());
  }
  const bool crops = SetCrop(options.roi_px);
  if (!options.roi_px.empty()) size = {options.roi_px[2], options.roi_px[3]};

  v4l2_format format{};
  format.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  Do(VIDIOC_G_FMT, &format, "ask for its format");
  auto& pix = format.fmt.pix;
  if (!size.empty()) {
    pix.width = static_cast<__u32>(size.width);
    pix.height = static_cast<__u32>(size.height);
  }
  const auto width = pix.width, height = pix.height;
  pix.pixelformat = CodeOf(name);
  pix.field = V4L2_FIELD_NONE;
  pix.bytesperline = pix.sizeimage = 0;
  Do(VIDIOC_S_FMT, &format, "set the format");
  if (NameOf(pix.pixelformat) != NameOf(CodeOf(name))) {
    throw Refused("set the format", "pixel_format: asked for \"" + name + "\", the driver gives \"" +
                                        NameOf(pix.pixelformat) + "\"; " + Offers());
  }
  if (pix.width != width || pix.height != height) {
    throw Refused("set the format", "roi_px: asked for " + Words(width, height) + " pixels, the driver gives " +
                                        Words(pix.width, pix.height) + "; " + Offers());
  }
  if (pix.field != V4L2_FIELD_NONE) {
    throw Refused("set the format", "pixel_format: the driver sends half pictures (interlaced)");
  }
  // The format may have moved the crop.
  if (crops && !options.roi_px.empty()) CheckCrop(options.roi_px);

  V4l2Format result{NameOf(pix.pixelformat), *layout, cv::Size(static_cast<int>(width), static_cast<int>(height)), 0};
  if (*layout != PixelLayout::kJpeg) {
    const std::size_t row = RowBytesOf(*layout, result.size.width);
    result.row_bytes = pix.bytesperline == 0 ? row : pix.bytesperline;
    if (result.row_bytes < row) {
      throw Refused("set the format", "pixel_format: the driver gives rows of " + std::to_string(result.row_bytes) +
                                          " bytes, they need " + std::to_string(row));
    }
  }
  return result;
}

std::optional<std::chrono::nanoseconds> V4l2Node::FrameInterval() const {
  v4l2_streamparm parameters{};
  parameters.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  const int error = Try(VIDIOC_G_PARM, &parameters);
  if (error != 0 && !IsUnknownCall(error)) throw ErrorOf(error, "ask for its frame rate");
  const auto& interval = parameters.parm.capture.timeperframe;
  if (error != 0 || interval.numerator == 0 || interval.denominator == 0) return std::nullopt;
  return std::chrono::nanoseconds(1'000'000'000LL * interval.numerator / interval.denominator);
}

}  // namespace granary
