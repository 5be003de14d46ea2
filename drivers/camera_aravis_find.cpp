// Aravis keeps one list of devices for the whole program and would look unknown names up in the DNS; so the list is
// made anew at each opening, under a lock, and Aravis is asked for nothing but what is on it.
#include "drivers/camera_aravis_find.h"

#include <arpa/inet.h>
#include <arv.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "drivers/errors.h"
#include "drivers/found_camera.h"
#include "drivers/gige_link.h"
#include "drivers/pixel_formats.h"

namespace granary {
namespace {

constexpr const char* kNoMac = "00:00:00:00:00:00";
// A program that died holds control until its heartbeat runs out, 3 s as cameras come.
constexpr std::chrono::milliseconds kControlTime{3000};
constexpr std::chrono::milliseconds kControlPause{250};
// A bootstrap register. Source: GigE Vision 2.0, "Primary Application IP Address".
constexpr guint64 kHolderAddressRegister = 0x0a14;

std::mutex& ListMutex() {
  static std::mutex mutex;
  return mutex;
}

struct ListedDevice {
  std::string arv_id, physical_id, address, vendor, model, serial;
  bool gige = false;

  /// As the configuration wants it.
  [[nodiscard]] std::string Id() const { return serial.empty() ? arv_id : vendor + "-" + serial; }
  [[nodiscard]] std::vector<std::string> OtherIds() const {
    std::vector<std::string> ids;
    for (const std::string& id : {serial, physical_id, address, arv_id}) {
      if (!id.empty() && id != kNoMac && id != Id()) ids.push_back(id);
    }
    return ids;
  }
};

std::string Text(const char* text) { return text == nullptr ? "" : text; }

std::vector<ListedDevice> ListDevices() {
  arv_update_device_list();
  std::vector<ListedDevice> devices;
  for (unsigned i = 0; i < arv_get_n_devices(); ++i) {
    ListedDevice device;
    device.arv_id = Text(arv_get_device_id(i));
    device.physical_id = Text(arv_get_device_physical_id(i));
    device.address = Text(arv_get_device_address(i));
    device.vendor = Text(arv_get_device_vendor(i));
    device.model = Text(arv_get_device_model(i));
    device.serial = Text(arv_get_device_serial_nbr(i));
    device.gige = Text(arv_get_device_protocol(i)) == "GigEVision";
    devices.push_back(std::move(device));
  }
  return devices;
}

std::string Lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

bool Names(const std::string& id, const ListedDevice& device) {
  const auto others = device.OtherIds();
  return id == device.Id() || std::any_of(others.begin(), others.end(), [&](const std::string& other) {
           return other == device.physical_id ? Lower(id) == Lower(other) : id == other;
         });
}

bool IsIp(const std::string& id) {
  in_addr address{};
  return ::inet_pton(AF_INET, id.c_str(), &address) == 1;
}

std::string ArvIdOf(const std::string& id) {
  const auto devices = ListDevices();
  std::vector<const ListedDevice*> named;
  std::string all;
  for (const ListedDevice& device : devices) {
    if (Names(id, device)) named.push_back(&device);
    all += (all.empty() ? "" : ", ") + device.Id();
  }
  if (named.empty()) {
    throw DeviceError(Reason::kCameraUnavailable, id, "open",
                      "no camera of this id answers; " + (all.empty() ? "there is none at all" : "there are: " + all));
  }
  if (named.size() > 1) {
    throw DeviceError(Reason::kCameraUnavailable, id, "open",
                      "the id names " + std::to_string(named.size()) + " cameras, choose one of " + all);
  }
  return named.front()->arv_id;
}

/// What can be told without writing to the camera.
void Describe(const ListedDevice& device, FoundCamera& found) {
  GErrorSlot error;
  const GOwner<ArvCamera> camera(arv_camera_new(device.arv_id.c_str(), error.Out()));
  if (!camera) {
    found.note = "cannot be opened: " + error.Words();
    return;
  }
  if (arv_camera_is_gv_device(camera.get()) &&
      !arv_gv_device_is_controller(ARV_GV_DEVICE(arv_camera_get_device(camera.get())))) {
    found.note = "in use by another program";
  }
  GErrorSlot formats_error;
  guint count = 0;
  const GMemory<const char*> formats(
      arv_camera_dup_available_pixel_formats_as_strings(camera.get(), &count, formats_error.Out()));
  if (formats_error || !formats) {
    found.note += (found.note.empty() ? "" : "; ") + ("its formats cannot be read: " + formats_error.Words());
    return;
  }
  for (guint i = 0; i < count; ++i) {
    if (LayoutOfGenicam(formats.get()[i])) found.formats.emplace_back(formats.get()[i]);
  }
  if (found.formats.empty()) found.note += std::string(found.note.empty() ? "" : "; ") + "it has no grey pixel format";
}

std::string DottedAddress(guint32 address) {
  return std::to_string(address >> 24) + "." + std::to_string(address >> 16 & 255) + "." +
         std::to_string(address >> 8 & 255) + "." + std::to_string(address & 255);
}

/// Aravis opens a camera that it does not control without a word.
void TakeControl(ArvGvDevice* device, const std::string& id) {
  const auto give_up = std::chrono::steady_clock::now() + kControlTime;
  while (!arv_gv_device_is_controller(device)) {
    std::this_thread::sleep_for(kControlPause);
    GErrorSlot error;
    if (arv_gv_device_take_control(device, error.Out()) || std::chrono::steady_clock::now() < give_up) continue;
    GErrorSlot no_holder;
    guint32 holder = 0;
    arv_device_read_register(ARV_DEVICE(device), kHolderAddressRegister, &holder, no_holder.Out());
    if (no_holder) throw DeviceError(Reason::kCameraUnavailable, id, "take control", no_holder.Words());
    throw DeviceError(Reason::kCameraInUse, id, "take control",
                      error.Words() + (holder != 0 ? "; it is held by a program on " + DottedAddress(holder)
                                                   : "; another program holds it"));
  }
}

GOwner<ArvCamera> OpenListed(const std::string& id) {
  const std::scoped_lock lock(ListMutex());
  const std::string arv_id = IsIp(id) ? id : ArvIdOf(id);
  GErrorSlot error;
  GOwner<ArvCamera> camera(arv_camera_new(arv_id.c_str(), error.Out()));
  if (camera) return camera;
  // libusb says no more of a camera that another program has claimed than these words.
  const bool claimed = error.Words().find("claim") != std::string::npos;
  throw DeviceError(claimed ? Reason::kCameraInUse : Reason::kCameraUnavailable, id, "open", error.Words());
}

}  // namespace

GOwner<ArvCamera> OpenArvCamera(const std::string& id) {
  GOwner<ArvCamera> camera = OpenListed(id);
  if (arv_camera_is_gv_device(camera.get())) TakeControl(ARV_GV_DEVICE(arv_camera_get_device(camera.get())), id);
  return camera;
}

std::vector<FoundCamera> FindAravisCameras() {
  const std::scoped_lock lock(ListMutex());
  std::vector<FoundCamera> cameras;
  for (const ListedDevice& device : ListDevices()) {
    FoundCamera found;
    found.driver = CameraDriver::kAravis;
    found.id = device.Id();
    found.other_ids = device.OtherIds();
    found.vendor = device.vendor;
    found.model = device.model;
    found.serial = device.serial;
    found.address = device.address;
    if (const auto interface = InterfaceTowards(device.address)) found.address += " (" + interface->name + ")";
    Describe(device, found);
    cameras.push_back(std::move(found));
  }
  std::sort(cameras.begin(), cameras.end(),
            [](const FoundCamera& one, const FoundCamera& other) { return one.id < other.id; });
  return cameras;
}

}  // namespace granary
