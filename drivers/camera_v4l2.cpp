// What a node sends is believed only as far as it can be checked: frames that the driver flags, that are too short or
// that began before Arm are dropped and counted, and times are told as the widest span that the stamp allows.
#include "drivers/camera_v4l2.h"

#include <optional>
#include <stdexcept>
#include <utility>

#include <spdlog/spdlog.h>

#include "drivers/errors.h"
#include "drivers/v4l2_controls.h"
#include "drivers/v4l2_node.h"
#include "drivers/v4l2_stream.h"

namespace granary {
namespace {

using std::chrono::nanoseconds;

constexpr unsigned kTriggeredBuffers = 4;
// A quarter of a second at 30 frames/s, while the other camera of the pair is made ready.
constexpr unsigned kFreeBuffers = 8;
// USB cameras need up to half a second from the start to the first frame.
constexpr std::chrono::seconds kStartTime{3};
// Pictures this soon after the start may be rubbish without meaning that the format is wrong.
constexpr int kFirstFrames = 3;
// A new exposure shows in the second frame after the one that was running when it was set.
constexpr int kExposureDelayFrames = 3;
// Without stamps: one frame may have been in transfer at Arm, one in exposure.
constexpr int kFramesUnderWay = 2;

/// The driver's own count, carried on over streams. Most drivers begin anew with each stream, some count on.
class FrameCounter {
 public:
  void StreamStarts() { first_ = true; }
  /// @return the number of this frame, from 1; 0 where the driver does not count
  std::uint64_t Next(std::uint32_t sequence) {
    const bool first = std::exchange(first_, false);
    if (!seen_) {
      id_ = 1;
    } else if (!first) {
      const std::uint32_t step = sequence - last_;
      counts_ = counts_ && step != 0;
      skipped_ += step > 1 ? step - 1 : 0;
      id_ += step;
    } else if (begins_anew_ || sequence <= last_) {
      begins_anew_ = true;
      id_ += 1 + std::uint64_t{sequence};
    } else {
      id_ += sequence - last_;
    }
    seen_ = true;
    last_ = sequence;
    return counts_ ? id_ : 0;
  }
  /// Frames missing between others of one stream, so far.
  [[nodiscard]] std::uint64_t skipped() const { return skipped_; }

 private:
  bool seen_ = false, first_ = true, begins_anew_ = false, counts_ = true;
  std::uint32_t last_ = 0;
  std::uint64_t id_ = 0, skipped_ = 0;
};

struct Span {
  nanoseconds start, end;
};

}  // namespace

struct CameraV4l2::Impl {
  Impl(const CameraOptions& wanted, TriggerMode wanted_trigger, cv::Size size, V4l2System& system);

  void WaitForFirstFrame();
  void Skip(int frames);
  void Drain();
  std::uint64_t Note(const V4l2Buffer& buffer);
  [[nodiscard]] Frame Wait(std::chrono::milliseconds timeout);
  [[nodiscard]] std::optional<Frame> Look(const V4l2Buffer& buffer);
  [[nodiscard]] bool IsStale(const V4l2Buffer& buffer);
  [[nodiscard]] std::optional<cv::Mat> CopyAndGiveBack(const V4l2Buffer& buffer);
  [[nodiscard]] std::optional<cv::Mat> PixelsOf(const V4l2Buffer& buffer);
  [[nodiscard]] std::optional<Span> SpanOf(const V4l2Buffer& buffer) const;
  [[nodiscard]] bool RunsFree() const { return trigger == TriggerMode::kFree; }

  std::string id;
  TriggerMode trigger;
  V4l2Node node;
  V4l2Format format;
  std::optional<nanoseconds> exposure, interval;
  bool interval_told = false;  ///< by the driver; else it is measured
  double exposure_set_us = 0;  ///< the last that was asked for
  V4l2Stream stream;
  FrameCounter counter;
  V4l2Counters counters;
  bool armed = false;
  nanoseconds armed_at{};          ///< CLOCK_MONOTONIC
  UtcTime utc_of_zero{};           ///< what UTC was when CLOCK_MONOTONIC was 0, as of the last Arm
  int frames_in_stream = 0;        ///< taken since it started
  bool running = false;            ///< a sound frame has come since it started
  int settling = 0;                ///< frames to come that may have the exposure of before
  int under_way = 0;               ///< frames to come that may have begun before Arm, where there is no stamp to tell
  std::optional<V4l2Buffer> last;  ///< of this stream
  std::string last_drop;           ///< why the last frame since Arm was dropped
};

CameraV4l2::Impl::Impl(const CameraOptions& wanted, TriggerMode wanted_trigger, cv::Size size, V4l2System& system)
    : id(wanted.id),
      trigger(wanted_trigger),
      node(system, wanted.id),
      format(node.SetFormat(wanted, size)),
      exposure_set_us(wanted.exposure_us),
      stream(node, wanted_trigger == TriggerMode::kFree ? kFreeBuffers : kTriggeredBuffers) {
  SwitchAutomaticsOff(node);
  if (!SetExposureTime(node, wanted.exposure_us)) {
    spdlog::warn("{}: has no exposure control in known units, exposure_us is not applied", id);
  }
  SetGain(node, wanted.gain_db);
  SetControls(node, wanted.features);
  // Not what was asked for: the features may have changed it.
  exposure = ExposureTime(node);
  if (!wanted.features.empty()) exposure_set_us = 0;
  interval = node.FrameInterval();
  interval_told = interval.has_value();
  spdlog::info("{}: {} ({}, {}) sends {} {}x{}", id, node.card(), node.driver(), node.bus(), format.name,
               format.size.width, format.size.height);
}

/// Counts a frame that was taken, whatever becomes of it. @return its number
std::uint64_t CameraV4l2::Impl::Note(const V4l2Buffer& buffer) {
  const std::uint64_t number = counter.Next(buffer.sequence);
  counters.skipped = counter.skipped();
  ++frames_in_stream;
  const bool stamped = buffer.stamp_source != StampSource::kUnknown;
  if (last && stamped && !interval_told && buffer.sequence - last->sequence == 1 && buffer.stamp > last->stamp) {
    interval = buffer.stamp - last->stamp;
  }
  if (stamped) last = buffer;
  return number;
}

/// Spoilt first frames are looked at and dropped like any other. Where the driver tells no frame interval it takes two.
void CameraV4l2::Impl::WaitForFirstFrame() {
  const auto deadline = node.system().Monotonic() + kStartTime;
  while (const auto buffer = stream.Take(deadline)) {
    Note(*buffer);
    const bool sound = CopyAndGiveBack(*buffer).has_value();
    running = sound && (interval || buffer->stamp_source == StampSource::kUnknown);
    if (running) return;
  }
  throw DeviceError(
      Reason::kFrameMissing, id, "start",
      "no frame within " + std::to_string(kStartTime.count()) + " s; it runs free and should send some" + last_drop);
}

/// Waits until so many frames are past.
void CameraV4l2::Impl::Skip(int frames) {
  const auto deadline = node.system().Monotonic() + kStartTime;
  for (; frames > 0; --frames) {
    const auto buffer = stream.Take(deadline);
    if (!buffer) throw DeviceError(Reason::kFrameMissing, id, "change the exposure", "the camera sends no more frames");
    Note(*buffer);
    ++counters.stale;
    stream.GiveBack(*buffer);
  }
}

/// Frames that waited since the last Disarm, and the one that some drivers (v4l2loopback) keep over streams.
void CameraV4l2::Impl::Drain() {
  for (std::size_t i = 0; i < 2 * stream.count(); ++i) {
    const auto buffer = stream.TryTake();
    if (!buffer) return;
    Note(*buffer);
    ++counters.stale;
    stream.GiveBack(*buffer);
  }
}

Frame CameraV4l2::Impl::Wait(std::chrono::milliseconds timeout) {
  const auto deadline = node.system().Monotonic() + timeout;
  while (const auto buffer = stream.Take(deadline)) {
    if (auto frame = Look(*buffer)) return *std::move(frame);
  }
  throw DeviceError(Reason::kFrameMissing, id, "grab",
                    "no frame within " + std::to_string(timeout.count()) + " ms" + last_drop);
}

/// The frame in a buffer, which goes back to the driver; empty when it is dropped.
std::optional<Frame> CameraV4l2::Impl::Look(const V4l2Buffer& buffer) {
  Frame frame;
  frame.frame_id = Note(buffer);
  const bool stale = IsStale(buffer);
  if (stale) {
    stream.GiveBack(buffer);
    ++counters.stale;
    last_drop = "; the last that came was from before Arm";
    return std::nullopt;
  }
  const auto pixels = CopyAndGiveBack(buffer);
  if (!pixels) return std::nullopt;
  ++counters.frames;
  frame.image = *pixels;
  frame.bit_depth = BitDepthOf(format.layout);
  frame.source = id;
  if (buffer.stamp_source != StampSource::kUnknown) frame.device_time = buffer.stamp;
  const auto span = RunsFree() ? SpanOf(buffer) : std::nullopt;
  if (span) {
    frame.exposure_start = utc_of_zero + span->start;
    frame.exposure_end = utc_of_zero + span->end;
  }
  return frame;
}

bool CameraV4l2::Impl::IsStale(const V4l2Buffer& buffer) {
  const auto span = RunsFree() ? SpanOf(buffer) : std::nullopt;
  if (span) return span->start < armed_at;
  if (RunsFree() && under_way > 0) {
    --under_way;
    return true;
  }
  // The span of a frame that a line triggered starts before Arm for all that is known; its stamp never does.
  return buffer.stamp_source != StampSource::kUnknown && buffer.stamp < armed_at;
}

/// Empty for a frame that is dropped.
std::optional<cv::Mat> CameraV4l2::Impl::CopyAndGiveBack(const V4l2Buffer& buffer) {
  std::optional<cv::Mat> pixels;
  try {
    pixels = PixelsOf(buffer);
  } catch (...) {
    stream.GiveBack(buffer);
    throw;
  }
  stream.GiveBack(buffer);
  if (!pixels) {
    ++counters.spoilt;
    spdlog::debug("{}: dropped a frame{}", id, last_drop);
  }
  return pixels;
}

/// Empty for a frame that is to be dropped; why is in last_drop.
std::optional<cv::Mat> CameraV4l2::Impl::PixelsOf(const V4l2Buffer& buffer) {
  if (buffer.spoilt) {
    last_drop = "; the driver flagged the last as spoilt";
    return std::nullopt;
  }
  const std::size_t row = RowBytesOf(format.layout, format.size.width);
  const auto rows = static_cast<std::size_t>(format.size.height);
  const std::size_t needed = row == 0 ? 1 : format.row_bytes * (rows - 1) + row;
  if (buffer.bytes.size() < needed) {
    last_drop = "; the last was too short, with " + std::to_string(buffer.bytes.size()) + " bytes";
    return std::nullopt;
  }
  try {
    return ToGrey(buffer.bytes, format.layout, format.size, format.row_bytes);
  } catch (const std::invalid_argument& error) {
    if (frames_in_stream > kFirstFrames) throw DeviceError(Reason::kFrameInvalid, id, "read the frame", error.what());
    last_drop = std::string("; the last was no whole picture (") + error.what() + ")";
    return std::nullopt;
  }
}

/// Outside of it no row was exposed; on CLOCK_MONOTONIC. Empty when the stamp or the interval is not known.
std::optional<Span> CameraV4l2::Impl::SpanOf(const V4l2Buffer& buffer) const {
  if (buffer.stamp_source == StampSource::kUnknown || !interval) return std::nullopt;
  // Rows are exposed one after the other and read out within a frame interval.
  const nanoseconds longest = exposure.value_or(*interval) + *interval;
  const bool at_end = buffer.stamp_source == StampSource::kEndOfFrame;
  // uvcvideo flags start of exposure; unless its parameter hwtimestamps is set, it stamps the first packet to arrive.
  const bool either = node.driver() == "uvcvideo";
  return Span{buffer.stamp - (at_end || either ? longest : nanoseconds(0)),
              buffer.stamp + (at_end ? nanoseconds(0) : longest)};
}

CameraV4l2::CameraV4l2(const CameraOptions& options, TriggerMode trigger, cv::Size size, V4l2System& system) {
  if (trigger == TriggerMode::kSoftware) {
    throw DeviceError(Reason::kSettingRefused, options.id, "open",
                      "trigger: a V4L2 node knows no software trigger; must be \"line0\" or \"free\"");
  }
  impl_ = std::make_unique<Impl>(options, trigger, size, system);
}

CameraV4l2::~CameraV4l2() = default;

std::string CameraV4l2::Id() const { return impl_->id; }

const V4l2Counters& CameraV4l2::counters() const { return impl_->counters; }

bool CameraV4l2::SetExposure(double exposure_us) {
  Impl& it = *impl_;
  if (exposure_us == it.exposure_set_us && it.exposure) return true;
  if (!SetExposureTime(it.node, exposure_us)) return false;
  it.exposure_set_us = exposure_us;
  it.exposure = ExposureTime(it.node);
  if (it.stream.on()) it.settling = kExposureDelayFrames;
  return true;
}

void CameraV4l2::Arm() {
  Impl& it = *impl_;
  it.armed = false;
  it.last_drop.clear();
  it.stream.ForgetInterrupt();
  const auto zero = [&] {
    const auto before = it.node.system().Monotonic();
    const UtcTime utc = it.node.system().Utc();
    return utc - (before + it.node.system().Monotonic()) / 2;
  };
  it.utc_of_zero = zero();
  if (!it.RunsFree() || !it.stream.on()) {
    it.armed_at = it.node.system().Monotonic();
    it.frames_in_stream = it.settling = 0;
    it.running = false;
    it.last.reset();
    it.counter.StreamStarts();
    it.stream.Start();
  }
  if (it.RunsFree() && !it.running) it.WaitForFirstFrame();
  it.Drain();
  if (it.RunsFree()) {
    it.Skip(std::exchange(it.settling, 0));
    it.armed_at = it.node.system().Monotonic();
    it.under_way = kFramesUnderWay;
  }
  it.armed = true;
}

Frame CameraV4l2::Grab(std::chrono::milliseconds timeout) {
  if (!impl_->armed) throw DeviceError(Reason::kFrameMissing, Id(), "grab", "the camera is not armed");
  return impl_->Wait(timeout);
}

void CameraV4l2::Disarm() noexcept {
  impl_->armed = false;
  if (!impl_->RunsFree()) impl_->stream.Stop();
}

void CameraV4l2::Interrupt() noexcept { impl_->stream.Interrupt(); }

}  // namespace granary
