// granaryctl cameras: what is there, by which driver, and how the configuration names it.
#include <CLI/CLI.hpp>

#include <functional>
#include <string>
#include <vector>

#include "config/values.h"
#include "daemon/ctl/command.h"
#include "drivers/errors.h"
#include "drivers/found_camera.h"

namespace granary {
namespace {

std::string DriverWord(CameraDriver driver) { return driver == CameraDriver::kAravis ? "aravis" : "v4l2"; }

nlohmann::ordered_json ToJson(const FoundCamera& camera) {
  return {{"driver", DriverWord(camera.driver)},
          {"id", camera.id},
          {"other_ids", camera.other_ids},
          {"vendor", camera.vendor},
          {"model", camera.model},
          {"serial", camera.serial},
          {"address", camera.address},
          {"formats", camera.formats},
          {"note", camera.note}};
}

std::string Joined(std::vector<std::string> words, const std::string& separator) {
  std::erase(words, "");
  return Join(words, separator);
}

void Show(const FoundCamera& camera) {
  Say("{ driver = \"" + DriverWord(camera.driver) + "\", id = " + Quote(camera.id) + " }");
  const auto line = [](const std::string& name, const std::string& words) {
    if (!words.empty()) Say("    " + name + words);
  };
  line("", Joined({camera.vendor, camera.model, camera.address}, ", "));
  line("also found as ", Joined(camera.other_ids, ", "));
  line("formats ", Joined(camera.formats, ", "));
  line("NOTE: ", camera.note);
}

int Cameras(const GlobalOptions& global) {
  std::vector<FoundCamera> found;
  std::string trouble;
  const auto look = [&](const std::function<std::vector<FoundCamera>()>& find) {
    try {
      for (FoundCamera& camera : find()) found.push_back(std::move(camera));
    } catch (const DeviceError& error) {
      trouble = error.what();
      Say("warning: " + trouble);  // the other driver's cameras are there all the same
    }
  };
  look(FindAravisCameras);
  look(FindV4l2Cameras);

  for (const FoundCamera& camera : found) Show(camera);
  if (found.empty()) {
    Say("no camera found; GigE cameras answer only in this computer's own networks, and only while no firewall drops "
        "UDP port 3956; USB cameras show up as /dev/video*");
  }
  if (global.json) {
    auto document = nlohmann::ordered_json::array();
    for (const FoundCamera& camera : found) document.push_back(ToJson(camera));
    PrintJson(document);
  }
  return trouble.empty() ? kExitDone : kExitFailed;
}

}  // namespace

void AddCameras(CLI::App& app, const GlobalOptions& global, Command& chosen) {
  CLI::App* command = app.add_subcommand("cameras", "the cameras found, each as the configuration wants it");
  command->callback([&global, &chosen] { chosen = [&global] { return Cameras(global); }; });
}

}  // namespace granary
