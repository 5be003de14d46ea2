// Aravis' fake camera does the protocol; here its sockets are checked, for it starts without them too, and its frames
// filled from the scene that both cameras share.
#include "drivers/sim/gige.h"

#include <arpa/inet.h>
#include <arv.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <system_error>

#include <spdlog/spdlog.h>

#include "drivers/sim/stage.h"

namespace granary {
namespace {

constexpr std::uint16_t kControlPort = 3956;  // GigE Vision's own
constexpr int kLargestSide_px = ARV_FAKE_CAMERA_SENSOR_WIDTH;
static_assert(ARV_FAKE_CAMERA_SENSOR_HEIGHT == kLargestSide_px);

struct Unref {
  void operator()(ArvGvFakeCamera* camera) const { g_object_unref(camera); }
};

std::string SerialOf(Side side) { return side == Side::kLeft ? "SIM-left" : "SIM-right"; }

std::runtime_error NotLocal(const std::string& address) {
  return std::runtime_error(address + ": no network interface has this address; `ip address add " + address +
                            "/8 dev lo` adds it, for which a namespace (unshare -rn) needs no root");
}

/// The fake starts without its sockets when it cannot have them, so they are asked for here before.
void CheckAddress(const std::string& address) {
  sockaddr_in wanted{};
  wanted.sin_family = AF_INET;
  wanted.sin_port = htons(kControlPort);
  const std::string where = address + " port " + std::to_string(kControlPort);
  if (inet_pton(AF_INET, address.c_str(), &wanted.sin_addr) != 1) {
    throw std::runtime_error(address + ": is no IPv4 address, as 127.0.0.1");
  }
  const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (socket < 0) throw std::system_error(errno, std::generic_category(), where + ": socket");
  const int error = bind(socket, reinterpret_cast<const sockaddr*>(&wanted), sizeof wanted) == 0 ? 0 : errno;
  close(socket);
  if (error == EADDRINUSE) {
    throw std::runtime_error(where + ": in use; an address has room for one GigE camera, another program has it");
  }
  if (error == EADDRNOTAVAIL) throw NotLocal(address);
  if (error != 0) throw std::system_error(error, std::generic_category(), where + ": bind");
}

std::uint16_t WireId(std::uint64_t shot) { return static_cast<std::uint16_t>((shot - 1) % 65535 + 1); }

}  // namespace

struct SimGige::Impl {
  /// One camera as its fill callback knows it.
  struct Eye {
    Impl* gige = nullptr;
    Side side = Side::kLeft;
    std::string address;
    double lost_percent = 0;
    std::unique_ptr<ArvGvFakeCamera, Unref> camera;  // last: its thread uses what stands above
  };

  Impl(const SimOptions& options, const RigWorld& world, const SimGigeOptions& gige);
  void Plug(Eye& eye);
  void Lose(Eye& eye, double percent) const;
  static void Fill(ArvBuffer* buffer, void* eye, guint32 exposure_us, guint32 gain, ArvPixelFormat format);

  cv::Size size;
  SimStage stage;
  std::array<Eye, 2> eyes;
};

SimGige::Impl::Impl(const SimOptions& options, const RigWorld& world, const SimGigeOptions& gige)
    : size(world.calibration.image_size), stage(options, world) {
  for (const Side side : {Side::kLeft, Side::kRight}) {
    Eye& eye = eyes.at(static_cast<std::size_t>(side));
    eye.gige = this;
    eye.side = side;
    eye.address = gige.addresses.at(static_cast<std::size_t>(side));
    eye.lost_percent = gige.lost_percent;
    Plug(eye);
  }
}

void SimGige::Impl::Plug(Eye& eye) {
  if (eye.camera) return;
  CheckAddress(eye.address);
  const std::string serial = SerialOf(eye.side);
  eye.camera.reset(arv_gv_fake_camera_new(eye.address.c_str(), serial.c_str()));
  if (!arv_gv_fake_camera_is_running(eye.camera.get())) {
    eye.camera.reset();
    throw NotLocal(eye.address);
  }
  ArvFakeCamera* fake = arv_gv_fake_camera_get_fake_camera(eye.camera.get());
  const auto width = static_cast<guint32>(size.width), height = static_cast<guint32>(size.height);
  for (const auto& [address, value] :
       {std::pair{ARV_FAKE_CAMERA_REGISTER_SENSOR_WIDTH, width},
        std::pair{ARV_FAKE_CAMERA_REGISTER_SENSOR_HEIGHT, height}, std::pair{ARV_FAKE_CAMERA_REGISTER_WIDTH, width},
        std::pair{ARV_FAKE_CAMERA_REGISTER_HEIGHT, height}}) {
    if (!arv_fake_camera_write_register(fake, address, value)) {
      throw std::logic_error("SimGige: the fake camera has no register " + std::to_string(address));
    }
  }
  arv_fake_camera_set_fill_pattern(fake, &Impl::Fill, &eye);
  Lose(eye, eye.lost_percent);
}

void SimGige::Impl::Lose(Eye& eye, double percent) const {
  eye.lost_percent = percent;
  if (eye.camera) g_object_set(eye.camera.get(), "gvsp-lost-ratio", percent / 100, nullptr);
}

/// Called by the camera's thread, with the buffer as large as the client's region and format want it.
void SimGige::Impl::Fill(ArvBuffer* buffer, void* eye, guint32 exposure_us, guint32 gain, ArvPixelFormat format) {
  const Eye& seen_by = *static_cast<const Eye*>(eye);
  const Frame frame =
      seen_by.gige->stage.TakePicture(seen_by.side, UtcTime(std::chrono::nanoseconds(arv_buffer_get_timestamp(buffer))),
                                      {static_cast<double>(exposure_us), static_cast<double>(gain)});
  arv_buffer_set_frame_id(buffer, WireId(frame.frame_id));
  arv_buffer_set_timestamp(buffer, static_cast<guint64>(frame.exposure_start.time_since_epoch().count()));

  cv::Rect region;
  arv_buffer_get_image_region(buffer, &region.x, &region.y, &region.width, &region.height);
  const bool deep = format == ARV_PIXEL_FORMAT_MONO_16;
  std::size_t received = 0;
  auto* pixels = static_cast<std::uint8_t*>(const_cast<void*>(arv_buffer_get_data(buffer, &received)));
  if (!deep && format != ARV_PIXEL_FORMAT_MONO_8) {
    // Aravis' description of the camera offers colours as well, and only the client can refuse them.
    spdlog::error("{}: the client wants pixel format 0x{:08x}, this camera has Mono8 and Mono16; it sends black",
                  IdOf(seen_by.side), format);
    std::fill_n(pixels, static_cast<std::size_t>(region.area()) * ARV_PIXEL_FORMAT_BIT_PER_PIXEL(format) / 8, 0);
    return;
  }
  cv::Mat sent(region.size(), deep ? CV_16UC1 : CV_8UC1, pixels);
  sent.setTo(0);  // there is no chip beyond the sensor's edge
  const cv::Rect on_chip = region & cv::Rect({}, frame.image.size());
  if (on_chip.empty()) return;
  // Full scale stays full scale.
  frame.image(on_chip).convertTo(sent(on_chip - region.tl()), sent.type(), deep ? 257 : 1);
}

SimGige::SimGige(const SimOptions& options, const RigWorld& world, const SimGigeOptions& gige) {
  const cv::Size size = world.calibration.image_size;
  if (size.width > kLargestSide_px || size.height > kLargestSide_px) {
    throw std::invalid_argument("image_width, image_height: " + std::to_string(size.width) + " x " +
                                std::to_string(size.height) + ", a simulated GigE camera has at most " +
                                std::to_string(kLargestSide_px) + " x " + std::to_string(kLargestSide_px));
  }
  for (const auto& address : gige.addresses) CheckAddress(address);  // before the scene is lit, which takes a second
  impl_ = std::make_unique<Impl>(options, world, gige);
}

SimGige::~SimGige() = default;

std::string SimGige::IdOf(Side side) { return "Aravis-" + SerialOf(side); }

void SimGige::Pull(Side side) { impl_->eyes.at(static_cast<std::size_t>(side)).camera.reset(); }
void SimGige::Plug(Side side) { impl_->Plug(impl_->eyes.at(static_cast<std::size_t>(side))); }
void SimGige::Lose(Side side, double percent) { impl_->Lose(impl_->eyes.at(static_cast<std::size_t>(side)), percent); }
void SimGige::SetLamp(bool works) { impl_->stage.SetLamp(works); }

}  // namespace granary
