// The kernel's virtual webcam in the guest: pulled and plugged in as a USB camera is, by driver unbind and bind.
#pragma once

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <thread>

namespace granary {

inline const std::string kVividPath = "/dev/v4l/by-path/platform-vivid.0-video-index0";

inline void WriteFile(const std::string& file, const std::string& words) {
  std::ofstream out(file);
  if (!(out << words).flush()) throw std::runtime_error(file + ": \"" + words + "\" is not taken");
}

/// Waits for what is sure to happen. @throws std::runtime_error after a minute
template <typename Condition>
void WaitFor(const std::string& what, Condition condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) throw std::runtime_error("waited in vain for " + what);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

inline void Unplug() {
  WriteFile("/sys/bus/platform/drivers/vivid/unbind", "vivid.0");
  // udev takes its link away a little later.
  WaitFor("the link to go", [] { return !std::filesystem::is_symlink(kVividPath); });
}

/// Returns when the node is there again under its path.
inline void Plug() {
  WriteFile("/sys/bus/platform/drivers/vivid/bind", "vivid.0");
  WaitFor("the node", [] { return std::filesystem::exists(kVividPath); });
}

/// Sets a control as an engineer would from the shell.
inline void SetControl(const std::string& control, int value) {
  const std::string command = "v4l2-ctl -d " + kVividPath + " -c " + control + "=" + std::to_string(value);
  if (std::system(command.c_str()) != 0) throw std::runtime_error(command + " failed");
}

}  // namespace granary
