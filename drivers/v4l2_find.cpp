// The id to put down is the one that stays when the camera is plugged in again: by-id, else by-path, else the number.
#include "drivers/v4l2_find.h"

#include <algorithm>
#include <string>
#include <system_error>
#include <utility>

#include "drivers/pixel_formats.h"
#include "drivers/v4l2_node.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> Entries(const fs::path& folder) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    entries.push_back(it->path());
  }
  std::sort(entries.begin(), entries.end());
  return entries;
}

/// videoN with its number.
std::vector<std::pair<int, fs::path>> Nodes(const fs::path& dev) {
  std::vector<std::pair<int, fs::path>> nodes;
  for (const fs::path& entry : Entries(dev)) {
    const std::string name = entry.filename();
    const std::string digits = name.rfind("video", 0) == 0 ? name.substr(5) : "";
    const bool number = !digits.empty() && digits.size() < 6 && digits.find_first_not_of("0123456789") == digits.npos;
    if (number) nodes.emplace_back(std::stoi(digits), entry);
  }
  std::sort(nodes.begin(), nodes.end());
  return nodes;
}

/// By which the node goes, the most lasting name first.
std::vector<std::string> NamesOf(const fs::path& node, const fs::path& dev) {
  std::vector<std::string> names;
  for (const char* folder : {"by-id", "by-path"}) {
    for (const fs::path& link : Entries(dev / "v4l" / folder)) {
      std::error_code error;
      if (fs::equivalent(link, node, error) && !error) names.push_back(link);
    }
  }
  names.push_back(node);
  return names;
}

}  // namespace

std::vector<FoundCamera> FindV4l2Cameras(V4l2System& system, const fs::path& dev) {
  std::vector<FoundCamera> cameras;
  for (const auto& [number, path] : Nodes(dev)) {
    FoundCamera camera;
    camera.driver = CameraDriver::kV4l2;
    camera.other_ids = NamesOf(path, dev);
    camera.id = camera.other_ids.front();
    camera.other_ids.erase(camera.other_ids.begin());
    try {
      const V4l2Node node(system, path);
      camera.model = node.card();
      camera.address = node.bus() + " (" + node.driver() + ")";
      for (const auto& format : node.FormatNames()) {
        if (LayoutOfV4l2(format)) camera.formats.push_back(format);
      }
      if (camera.formats.empty()) camera.note = "sends no format that this program reads";
    } catch (const DeviceError& error) {
      // Nodes of metadata, output nodes: no cameras.
      if (error.reason() == Reason::kSettingRefused) continue;
      camera.note = error.what();
    }
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

std::vector<FoundCamera> FindV4l2Cameras() { return FindV4l2Cameras(KernelV4l2(), "/dev"); }

}  // namespace granary
