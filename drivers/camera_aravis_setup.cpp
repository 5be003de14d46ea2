// The order matters: formats before sizes, the trigger's selector before its mode and source, what the integrator adds
// last.
#include "drivers/camera_aravis_setup.h"

#include <arv.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string_view>

#include "drivers/camera_aravis_glib.h"
#include "pipeline/types/frame.h"

namespace granary {
namespace {

using std::chrono::nanoseconds;

constexpr double kExposureTolerance = 0.05;
constexpr double kGainTolerance_db = 0.2;
// The latch command's way there and back comes on top.
constexpr std::chrono::microseconds kPtpTolerance{1000};

UtcTime NowUtc() { return std::chrono::time_point_cast<nanoseconds>(std::chrono::system_clock::now()); }

/// Seconds that International Atomic Time, which PTP masters keep, is ahead of the host's clock.
std::chrono::seconds TaiAhead() {
  timespec tai{}, utc{};
  clock_gettime(CLOCK_TAI, &tai);
  clock_gettime(CLOCK_REALTIME, &utc);
  const std::int64_t ahead_s = tai.tv_sec - utc.tv_sec;
  return std::chrono::seconds(ahead_s > 1 ? ahead_s : 37);  // 0 where nobody told the kernel; 37 since 2017
}

PixelLayout SetPixelFormat(const CameraFeatures& features, const std::string& asked) {
  const std::string format = asked.empty() ? "Mono8" : asked;
  std::string readable;
  for (const std::string& offered : features.Entries("PixelFormat")) {
    if (LayoutOfGenicam(offered)) readable += (readable.empty() ? "" : ", ") + offered;
  }
  const auto layout = LayoutOfGenicam(format);
  const auto offered = features.Entries("PixelFormat");
  if (!layout || std::find(offered.begin(), offered.end(), format) == offered.end()) {
    features.Refuse("pixel_format", "\"" + format + "\" is not to be had of this camera, allowed is " +
                                        (readable.empty() ? "nothing: it has no grey format" : readable));
  }
  features.SetEntry("pixel_format", "PixelFormat", format);
  return *layout;
}

cv::Size SetRegion(const CameraFeatures& features, const std::vector<int>& roi_px, cv::Size size) {
  int x = 0, y = 0;
  if (!roi_px.empty()) {
    x = roi_px[0];
    y = roi_px[1];
    size = {roi_px[2], roi_px[3]};
  }
  const auto set_offset = [&](const char* name, int offset) {
    if (features.Has(name) || offset != 0) features.SetNumber("roi_px", name, offset);
  };
  // From (0, 0) the camera allows every size that it has.
  set_offset("OffsetX", 0);
  set_offset("OffsetY", 0);
  const cv::Size largest(static_cast<int>(features.Range("Width").second),
                         static_cast<int>(features.Range("Height").second));
  if (size.empty()) size = largest;
  if (x + size.width > largest.width || y + size.height > largest.height) {
    features.Refuse("roi_px", std::to_string(size.width) + "x" + std::to_string(size.height) + " from (" +
                                  std::to_string(x) + ", " + std::to_string(y) + ") does not fit, allowed is up to " +
                                  std::to_string(largest.width) + "x" + std::to_string(largest.height) +
                                  " from (0, 0)");
  }
  features.SetNumber("roi_px", "Width", size.width);
  features.SetNumber("roi_px", "Height", size.height);
  if (x != 0) set_offset("OffsetX", x);
  if (y != 0) set_offset("OffsetY", y);
  return size;
}

void SetGain(const CameraFeatures& features, double gain_db) {
  if (features.Has("GainAuto")) features.SetEntry("gain_db", "GainAuto", "Off");
  if (features.Has("Gain")) {
    features.SetNumber("gain_db", "Gain", gain_db, kGainTolerance_db);
    return;
  }
  // Steps without a unit are no decibels; the least of them is the sensor as it is.
  const std::string steps = features.FirstOf({"GainRaw", "GainAbs"});
  if (gain_db != 0) {
    features.Refuse("gain_db", steps.empty()
                                   ? "the camera has no gain, allowed is 0"
                                   : "the camera's gain " + steps + " is not in decibels, allowed is 0; set features." +
                                         steps + " instead, " + features.Allowed(steps));
  }
  if (!steps.empty()) features.SetNumber("gain_db", steps, features.Range(steps).first);
}

void SetTrigger(const CameraFeatures& features, TriggerMode trigger, const std::vector<Feature>& extra) {
  if (features.Has("AcquisitionMode")) features.SetEntry("trigger", "AcquisitionMode", "Continuous");
  if (features.Has("TriggerSelector")) {
    // A trigger of another kind left on from before would keep the camera waiting.
    for (const std::string& other : features.Entries("TriggerSelector")) {
      features.SetEntry("trigger", "TriggerSelector", other);
      if (features.Has("TriggerMode")) features.SetEntry("trigger", "TriggerMode", "Off");
    }
    features.SetEntry("trigger", "TriggerSelector", "FrameStart");
  }
  if (trigger == TriggerMode::kFree) {
    if (features.Has("TriggerMode")) features.SetEntry("trigger", "TriggerMode", "Off");
    return;
  }
  features.SetEntry("trigger", "TriggerMode", "On");
  if (trigger == TriggerMode::kSoftware) {
    features.SetEntry("trigger", "TriggerSource", "Software");
    return;
  }
  // Cameras number their inputs differently: the features table may name the line that is wired.
  const bool named =
      std::any_of(extra.begin(), extra.end(), [](const Feature& feature) { return feature.first == "TriggerSource"; });
  if (!named) features.SetEntry("trigger", "TriggerSource", "Line0");
  if (features.Has("TriggerActivation")) features.SetEntry("trigger", "TriggerActivation", "RisingEdge");
}

void SetPacketSize(ArvCamera& camera, const CameraFeatures& features, int packet_size, int mtu) {
  ArvGvDevice* device = ARV_GV_DEVICE(arv_camera_get_device(&camera));
  // Aravis would do it again when the stream is made, and then only to see whether the size in use passes.
  arv_gv_device_set_packet_size_adjustment(device, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
  if (packet_size == 0) {
    GErrorSlot error;
    packet_size = static_cast<int>(arv_gv_device_auto_packet_size(device, error.Out()));
    features.Check(error, "find the packet size");
    // A camera that cannot send test packets keeps its own size, which may be more than the wire takes.
    if (mtu > 0 && packet_size > mtu) packet_size = mtu / 4 * 4;
  }
  GErrorSlot error;
  arv_gv_device_set_packet_size(device, packet_size, error.Out());
  features.Check(error, "set packet_size");
  if (const int read = PacketSize(camera, features); read != packet_size) {
    features.Refuse("packet_size", "the camera made " + std::to_string(read) + " of " + std::to_string(packet_size) +
                                       ", allowed is " + features.Allowed("GevSCPSPacketSize"));
  }
}

void EnablePtp(const CameraFeatures& features) {
  const std::string enable = features.FirstOf({"PtpEnable", "GevIEEE1588"});
  if (enable.empty()) features.Refuse("ptp", "the camera does not follow PTP, allowed is false");
  features.Set("ptp", {enable, true});
}

}  // namespace

CameraSettings SetUpCamera(ArvCamera& camera, const CameraFeatures& features, const CameraOptions& options,
                           TriggerMode trigger, cv::Size size, int mtu) {
  GErrorSlot stop_error;
  arv_camera_stop_acquisition(&camera, stop_error.Out());
  features.Check(stop_error, "stop acquisition");

  CameraSettings set;
  set.layout = SetPixelFormat(features, options.pixel_format);
  GErrorSlot format_error;
  set.pixel_format = arv_camera_get_pixel_format(&camera, format_error.Out());
  features.Check(format_error, "read PixelFormat");
  set.size = SetRegion(features, options.roi_px, size);

  set.exposure_feature = features.FirstOf({"ExposureTime", "ExposureTimeAbs"});
  if (set.exposure_feature.empty()) features.Refuse("exposure_us", "the camera has no exposure time in microseconds");
  if (features.Has("ExposureAuto")) features.SetEntry("exposure_us", "ExposureAuto", "Off");
  SetExposureTime(features, set.exposure_feature, options.exposure_us);
  SetGain(features, options.gain_db);
  SetTrigger(features, trigger, options.features);

  if (arv_camera_is_gv_device(&camera)) {
    SetPacketSize(camera, features, options.packet_size, mtu);
    if (options.packet_delay_ns) SetPacketDelay(camera, features, *options.packet_delay_ns);
  }
  if (options.ptp) EnablePtp(features);
  for (const Feature& feature : options.features) features.Set("features." + feature.first, feature);

  set.temperature_feature = features.FirstOf({"DeviceTemperature"});
  const char* vendor = arv_camera_get_vendor_name(&camera, nullptr);
  const char* model = arv_camera_get_model_name(&camera, nullptr);
  set.simulated = vendor != nullptr && model != nullptr && vendor == std::string_view("Aravis") &&
                  model == std::string_view("Fake");
  return set;
}

void SetExposureTime(const CameraFeatures& features, const std::string& exposure_feature, double exposure_us) {
  features.SetNumber("exposure_us", exposure_feature, exposure_us, kExposureTolerance * exposure_us);
}

int PacketSize(ArvCamera& camera, const CameraFeatures& features) {
  GErrorSlot error;
  const guint size = arv_camera_gv_get_packet_size(&camera, error.Out());
  features.Check(error, "read packet_size");
  return static_cast<int>(size);
}

void SetPacketDelay(ArvCamera& camera, const CameraFeatures& features, std::int64_t delay_ns) {
  GErrorSlot set_error, get_error, no_clock;
  arv_camera_gv_set_packet_delay(&camera, delay_ns, set_error.Out());
  features.Check(set_error, "set packet_delay_ns");
  const gint64 read = arv_camera_gv_get_packet_delay(&camera, get_error.Out());
  features.Check(get_error, "read packet_delay_ns");
  // The camera counts in ticks of its clock.
  const guint64 frequency =
      arv_gv_device_get_timestamp_tick_frequency(ARV_GV_DEVICE(arv_camera_get_device(&camera)), no_clock.Out());
  const std::int64_t tick_ns = frequency == 0 ? 0 : static_cast<std::int64_t>(1'000'000'000 / frequency);
  if (std::abs(read - delay_ns) > tick_ns) {
    features.Refuse("packet_delay_ns", "the camera made " + std::to_string(read) + " of " + std::to_string(delay_ns) +
                                           ", allowed in ticks of " + std::to_string(tick_ns) + " ns is " +
                                           features.Allowed("GevSCPD"));
  }
}

std::chrono::seconds CheckPtp(const CameraFeatures& features) {
  if (const std::string latch = features.FirstOf({"PtpDataSetLatch", "GevIEEE1588DataSetLatch"}); !latch.empty()) {
    features.Execute(latch);
  }
  const std::string status = features.FirstOf({"PtpStatus", "GevIEEE1588Status"});
  const std::string is = status.empty() ? "not told" : features.Text(status);
  if (is != "Slave" && is != "Master") {
    features.Fail(Reason::kCameraUnavailable, "check PTP", "ptp: the status is " + is + ", must be Slave or Master");
  }
  const bool standard = features.Has("TimestampLatch");
  const std::string latch = standard ? "TimestampLatch" : "GevTimestampControlLatch";
  const std::string value = standard ? "TimestampLatchValue" : "GevTimestampValue";
  if (!features.Has(latch) || !features.Has(value)) {
    features.Refuse("ptp", "the camera's clock cannot be read to be checked, allowed is false");
  }
  const UtcTime before = NowUtc();
  features.Execute(latch);
  const UtcTime after = NowUtc();
  const UtcTime told{nanoseconds(features.Integer(value))};
  for (const std::chrono::seconds ahead : {std::chrono::seconds(0), TaiAhead()}) {
    if (told - ahead >= before - kPtpTolerance && told - ahead <= after + kPtpTolerance) return ahead;
  }
  const auto apart_ms = std::chrono::duration_cast<std::chrono::milliseconds>(told - before).count();
  features.Fail(Reason::kCameraUnavailable, "check PTP",
                "ptp: the camera's clock is " + std::to_string(apart_ms) +
                    " ms ahead of the host's; both must follow one master (ptp4l and phc2sys on the host)");
}

}  // namespace granary
