// The camera streams from its first Arm until it is closed, so that its frame ids count on, and the trigger keeps it
// quiet; one that runs free streams from Arm to Disarm. Calls into Aravis come from one thread; its heartbeat thread
// does no more than note that control was lost.
#include "drivers/camera_aravis.h"

#include <arv.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <fstream>
#include <functional>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <spdlog/spdlog.h>

#include "drivers/camera_aravis_features.h"
#include "drivers/camera_aravis_find.h"
#include "drivers/camera_aravis_glib.h"
#include "drivers/camera_aravis_setup.h"
#include "drivers/errors.h"
#include "drivers/gige_link.h"
#include "drivers/pixel_formats.h"

namespace granary {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

// Enough for the frames of one shot and what a stray trigger adds before the next Arm.
constexpr int kBuffers = 8;
constexpr milliseconds kGrabSlice{100};
// A frame that was triggered and not seen comes within this time or not at all.
constexpr milliseconds kLateFrameTime{300};
constexpr double kUnknownLink_mbps = 1000;

// A bootstrap register. Source: GigE Vision 2.0, "Control Channel Privilege".
constexpr guint64 kControlRegister = 0x0a00;
constexpr guint32 kControlBits = 0x3;  // exclusive or control access
constexpr int kGvspHeaders = 36;       // bytes of IP, UDP and GVSP in front of a packet's pixels

std::string StatusWords(ArvBufferStatus status) {
  switch (status) {
    case ARV_BUFFER_STATUS_TIMEOUT:
      return "it was not complete in time";
    case ARV_BUFFER_STATUS_MISSING_PACKETS:
      return "packets are missing";
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID:
      return "a packet has a wrong number";
    case ARV_BUFFER_STATUS_SIZE_MISMATCH:
      return "it does not have the size that was set";
    case ARV_BUFFER_STATUS_ABORTED:
      return "its transfer was aborted";
    default:
      return "its buffer has status " + std::to_string(status);
  }
}

/// The buffer goes back to the stream whatever becomes of its frame: those held for long end in TIMEOUT for ever.
struct PushBack {
  ArvStream* stream = nullptr;
  void operator()(ArvBuffer* buffer) const { arv_stream_push_buffer(stream, buffer); }
};
using PoppedBuffer = std::unique_ptr<ArvBuffer, PushBack>;

UtcTime NowUtc() { return std::chrono::time_point_cast<nanoseconds>(std::chrono::system_clock::now()); }

}  // namespace

struct CameraAravis::Impl {
  Impl(const CameraOptions& camera_options, TriggerMode trigger_mode, cv::Size size);
  ~Impl();
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  void LookAtLink();
  void CreateStream();

  void CheckThere(const std::string& operation) const;
  void Ask(const std::string& operation, const std::function<void()>& question);
  void Arm();
  void CheckControl() const;
  void Start();
  void Stop() noexcept;
  [[nodiscard]] bool IsReceiving() const;
  void Drain();
  [[nodiscard]] PoppedBuffer Pop(milliseconds timeout) const;
  [[nodiscard]] bool IsStale(ArvBuffer& buffer) const;
  [[nodiscard]] Frame FrameOf(ArvBuffer& buffer);
  [[nodiscard]] std::string Losses() const;
  [[nodiscard]] std::uint64_t MissingPackets() const;

  [[noreturn]] void Fail(Reason reason, const std::string& operation, const std::string& words) const {
    throw DeviceError(reason, options.id, operation, words);
  }

  std::atomic<bool> control_lost{false};  ///< by the heartbeat thread, which lives until `camera` is gone
  std::atomic<bool> interrupted{false};
  bool failed = false;  ///< a call found the camera gone: do not wait for it again

  CameraOptions options;
  TriggerMode trigger;
  GOwner<ArvCamera> camera;
  ArvDevice* device = nullptr;
  CameraFeatures features;
  GOwner<ArvStream> stream;
  CameraSettings set;
  bool gige = false, streaming = false, armed = false;
  bool has_clock = true;  ///< the buffers' time is the camera's, not Aravis' own in its stead
  double exposure_us = 0;
  std::size_t packets_per_frame = 0;
  std::optional<NetworkInterface> interface;
  FrameIds ids;
  UtcTime armed_at{};
  std::optional<double> temperature_c;
  std::optional<std::chrono::seconds> ptp_ahead;  ///< of the host's clock, when the camera follows PTP
  std::uint64_t missing_before = 0;               ///< packets missing when armed
  std::uint64_t stale_frames = 0;
  bool owed = false;  ///< a frame was triggered and not seen yet
};

CameraAravis::Impl::Impl(const CameraOptions& camera_options, TriggerMode trigger_mode, cv::Size frame_size)
    : options(camera_options),
      trigger(trigger_mode),
      camera(OpenArvCamera(options.id)),
      device(arv_camera_get_device(camera.get())),
      features(device, options.id),
      gige(arv_camera_is_gv_device(camera.get()) != FALSE) {
  g_signal_connect(device, "control-lost",
                   G_CALLBACK(+[](ArvDevice*, gpointer lost) { static_cast<std::atomic<bool>*>(lost)->store(true); }),
                   &control_lost);
  if (gige) LookAtLink();
  set = SetUpCamera(*camera, features, options, trigger, frame_size, interface ? interface->mtu : 0);
  exposure_us = options.exposure_us;
  CreateStream();
}

CameraAravis::Impl::~Impl() {
  Stop();
  // Before the device: it joins the thread that fills buffers.
  stream.reset();
}

void CameraAravis::Impl::LookAtLink() {
  ArvGvDevice* gv_device = ARV_GV_DEVICE(device);
  const GMemory<char> ip(g_inet_address_to_string(
      g_inet_socket_address_get_address(G_INET_SOCKET_ADDRESS(arv_gv_device_get_device_address(gv_device)))));
  interface = InterfaceTowards(ip.get());
  GErrorSlot no_clock;
  has_clock = arv_gv_device_get_timestamp_tick_frequency(gv_device, no_clock.Out()) != 0 && !no_clock;
}

void CameraAravis::Impl::CreateStream() {
  GErrorSlot payload_error, stream_error;
  const guint payload = arv_camera_get_payload(camera.get(), payload_error.Out());
  features.Check(payload_error, "read PayloadSize");
  stream.reset(arv_camera_create_stream(camera.get(), nullptr, nullptr, stream_error.Out()));
  features.Check(stream_error, "create the stream");
  if (!stream) Fail(Reason::kCameraUnavailable, "create the stream", stream_error.Words());
  if (gige) {
    g_object_set(stream.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
                 options.socket_buffer_kib * 1024, nullptr);
    // On by default, where the camera can.
    if (!options.resend) g_object_set(stream.get(), "packet-resend", ARV_GV_STREAM_PACKET_RESEND_NEVER, nullptr);
    int most = 0;
    if (std::ifstream("/proc/sys/net/core/rmem_max") >> most && most / 1024 < options.socket_buffer_kib) {
      spdlog::info("{}: socket_buffer_kib = {}, but net.core.rmem_max allows {} KiB without CAP_NET_RAW", options.id,
                   options.socket_buffer_kib, most / 1024);
    }
    const int pixels = PacketSize(*camera, features) - kGvspHeaders;
    packets_per_frame = (payload + pixels - 1) / pixels + 2;
  }
  for (int i = 0; i < kBuffers; ++i) arv_stream_push_buffer(stream.get(), arv_buffer_new_allocate(payload));
}

void CameraAravis::Impl::CheckThere(const std::string& operation) const {
  if (control_lost) Fail(Reason::kCameraUnavailable, operation, "control of the camera was lost");
}

/// Asks the camera, so that one that was pulled a moment ago is not taken for one without a trigger.
void CameraAravis::Impl::CheckControl() const {
  if (!gige) return;
  GErrorSlot error;
  guint32 control = 0;
  arv_device_read_register(device, kControlRegister, &control, error.Out());
  features.Check(error, "ask for control");
  if ((control & kControlBits) == 0) {
    Fail(Reason::kCameraUnavailable, "ask for control", "the camera has forgotten it: it was restarted");
  }
}

/// What waits for the camera's answer; once one did not come, none is waited for again.
void CameraAravis::Impl::Ask(const std::string& operation, const std::function<void()>& question) {
  CheckThere(operation);
  try {
    question();
  } catch (const DeviceError& error) {
    failed = failed || error.reason() == Reason::kCameraUnavailable;
    throw;
  }
}

void CameraAravis::Impl::Arm() {
  CheckControl();
  if (options.ptp) ptp_ahead = CheckPtp(features);
  if (!set.temperature_feature.empty()) temperature_c = features.Number(set.temperature_feature);
  stale_frames = 0;
  Drain();
  missing_before = MissingPackets();
  interrupted = false;
  armed_at = NowUtc();
  Start();
  owed = trigger == TriggerMode::kLine0;
  armed = true;
}

void CameraAravis::Impl::Start() {
  if (streaming) return;
  GErrorSlot error;
  arv_camera_start_acquisition(camera.get(), error.Out());
  features.Check(error, "start acquisition");
  streaming = true;
}

void CameraAravis::Impl::Stop() noexcept {
  if (!streaming) return;
  streaming = false;
  if (control_lost || failed) return;  // each call would wait seconds for an answer
  GErrorSlot error;
  arv_camera_stop_acquisition(camera.get(), error.Out());
  if (!error) return;
  failed = true;
  spdlog::warn("{}: stop acquisition: {}", options.id, error.Words());
}

PoppedBuffer CameraAravis::Impl::Pop(milliseconds timeout) const {
  const auto timeout_us = static_cast<guint64>(std::chrono::microseconds(timeout).count());
  return {timeout.count() > 0 ? arv_stream_timeout_pop_buffer(stream.get(), timeout_us)
                              : arv_stream_try_pop_buffer(stream.get()),
          PushBack{stream.get()}};
}

/// Whether a frame is being received at this moment.
bool CameraAravis::Impl::IsReceiving() const {
  gint waiting = 0, done = 0;
  arv_stream_get_n_buffers(stream.get(), &waiting, &done);
  return waiting + done < kBuffers;
}

void CameraAravis::Impl::Drain() {
  const auto give_up = std::chrono::steady_clock::now() + kLateFrameTime;
  for (;;) {
    const bool may_come = (owed || IsReceiving()) && std::chrono::steady_clock::now() < give_up;
    const PoppedBuffer buffer = Pop(milliseconds(may_come ? 10 : 0));
    if (!buffer && !may_come) break;
    if (!buffer) continue;
    owed = false;
    ++stale_frames;
    if (arv_buffer_get_status(buffer.get()) == ARV_BUFFER_STATUS_SUCCESS) {
      (void)ids.Extend(arv_buffer_get_frame_id(buffer.get()));
    }
  }
  owed = false;
}

/// Was it exposed before Arm? Where the cameras' clock is not the host's, its first packet tells, which leaves the
/// camera when the exposure has begun, or ended.
bool CameraAravis::Impl::IsStale(ArvBuffer& buffer) const {
  const nanoseconds exposure(std::llround(1000 * exposure_us));
  if (ptp_ahead) return UtcTime(nanoseconds(arv_buffer_get_timestamp(&buffer)) - *ptp_ahead) < armed_at;
  const UtcTime arrived{nanoseconds(arv_buffer_get_system_timestamp(&buffer))};
  return arrived - (trigger == TriggerMode::kFree ? exposure : nanoseconds(0)) < armed_at;
}

Frame CameraAravis::Impl::FrameOf(ArvBuffer& buffer) {
  gint width = 0, height = 0, x_padding = 0, y_padding = 0;
  arv_buffer_get_image_region(&buffer, nullptr, nullptr, &width, &height);
  arv_buffer_get_image_padding(&buffer, &x_padding, &y_padding);
  if (cv::Size(width, height) != set.size || arv_buffer_get_image_pixel_format(&buffer) != set.pixel_format) {
    Fail(Reason::kFrameInvalid, "grab",
         "the frame has " + std::to_string(width) + "x" + std::to_string(height) +
             " pixels, or another format than was set");
  }
  std::size_t bytes = 0;
  const void* data = arv_buffer_get_image_data(&buffer, &bytes);
  if (data == nullptr) Fail(Reason::kFrameInvalid, "grab", "the frame has no pixels");

  Frame frame;
  try {
    frame.image = ToGrey({static_cast<const std::byte*>(data), bytes}, set.layout, set.size,
                         RowBytesOf(set.layout, width) + static_cast<std::size_t>(x_padding));
  } catch (const std::invalid_argument& error) {
    Fail(Reason::kFrameInvalid, "grab", error.what());
  }
  frame.bit_depth = BitDepthOf(set.layout);
  frame.frame_id = ids.Extend(arv_buffer_get_frame_id(&buffer));
  frame.temperature_c = temperature_c;
  frame.source = options.id;
  frame.simulated = set.simulated;
  if (const auto told = arv_buffer_get_timestamp(&buffer); has_clock && told != 0) {
    frame.device_time = nanoseconds(told);
    if (ptp_ahead) {
      frame.exposure_start = UtcTime(*frame.device_time - *ptp_ahead);
      frame.exposure_end = frame.exposure_start + nanoseconds(std::llround(1000 * exposure_us));
    }
  }
  return frame;
}

std::uint64_t CameraAravis::Impl::MissingPackets() const {
  if (!gige) return 0;
  guint64 resent = 0, missing = 0;
  arv_gv_stream_get_statistics(ARV_GV_STREAM(stream.get()), &resent, &missing);
  return missing;
}

std::string CameraAravis::Impl::Losses() const {
  std::string words;
  if (const auto missing = MissingPackets() - missing_before; missing > 0) {
    words += "; " + std::to_string(missing) + " packets missing of " + std::to_string(packets_per_frame) + " a frame";
  }
  if (stale_frames > 0) words += "; " + std::to_string(stale_frames) + " frames from before dropped";
  return words;
}

CameraAravis::CameraAravis(const CameraOptions& options, TriggerMode trigger, cv::Size size)
    : impl_(std::make_unique<Impl>(options, trigger, size)) {}

CameraAravis::~CameraAravis() = default;

std::string CameraAravis::Id() const { return impl_->options.id; }

bool CameraAravis::SetExposure(double exposure_us) {
  impl_->Ask("set the exposure", [&] {
    SetExposureTime(impl_->features, impl_->set.exposure_feature, exposure_us);
    impl_->exposure_us = exposure_us;
  });
  return true;
}

void CameraAravis::Arm() {
  impl_->Ask("arm", [this] { impl_->Arm(); });
}

void CameraAravis::Trigger() {
  if (impl_->trigger != TriggerMode::kSoftware) return;
  impl_->Ask("trigger", [this] {
    impl_->owed = true;
    impl_->features.Execute("TriggerSoftware");
  });
}

Frame CameraAravis::Grab(milliseconds timeout) {
  Impl& impl = *impl_;
  if (!impl.armed) impl.Fail(Reason::kFrameMissing, "grab", "the camera is not armed");
  const auto until = std::chrono::steady_clock::now() + timeout;
  for (;;) {
    impl.CheckThere("grab");
    if (impl.interrupted) impl.Fail(Reason::kFrameMissing, "grab", "interrupted");
    const auto left = std::chrono::ceil<milliseconds>(until - std::chrono::steady_clock::now());
    const PoppedBuffer buffer = impl.Pop(std::clamp(left, milliseconds(0), kGrabSlice));
    if (!buffer) {
      if (left.count() > 0) continue;
      impl.Fail(Reason::kFrameMissing, "grab",
                "no frame came within " + std::to_string(timeout.count()) + " ms" + impl.Losses());
    }
    impl.owed = false;
    const ArvBufferStatus status = arv_buffer_get_status(buffer.get());
    if (status != ARV_BUFFER_STATUS_SUCCESS) {
      impl.Fail(Reason::kFrameMissing, "grab", "the frame is broken: " + StatusWords(status) + impl.Losses());
    }
    if (!impl.IsStale(*buffer)) return impl.FrameOf(*buffer);
    ++impl.stale_frames;
    (void)impl.ids.Extend(arv_buffer_get_frame_id(buffer.get()));
  }
}

void CameraAravis::Disarm() noexcept {
  impl_->armed = false;
  if (impl_->trigger == TriggerMode::kFree) impl_->Stop();
}

void CameraAravis::Interrupt() noexcept { impl_->interrupted = true; }

void CameraAravis::ShareLink(CameraAravis& left, CameraAravis& right) {
  const std::vector<Impl*> cameras{left.impl_.get(), right.impl_.get()};
  if (!std::all_of(cameras.begin(), cameras.end(), [](const Impl* camera) { return camera->interface.has_value(); }) ||
      cameras[0]->interface->name != cameras[1]->interface->name) {
    return;
  }
  const auto own_speed_mbps = [](const Impl& camera) {
    const double told =
        camera.features.Has("GevLinkSpeed") ? static_cast<double>(camera.features.Integer("GevLinkSpeed")) : 0;
    return told > 0 ? told : camera.interface->speed_mbps.value_or(kUnknownLink_mbps);
  };
  for (Impl* camera : cameras) {
    if (camera->options.packet_delay_ns) continue;
    const double camera_mbps = own_speed_mbps(*camera);
    const double link_mbps = camera->interface->speed_mbps.value_or(camera_mbps);
    const int packet_size = PacketSize(*camera->camera, camera->features);
    const auto delay_ns = PacketDelay_ns(packet_size, camera_mbps, LinkShare_mbps(link_mbps, 2));
    SetPacketDelay(*camera->camera, camera->features, delay_ns);
  }
}

}  // namespace granary
