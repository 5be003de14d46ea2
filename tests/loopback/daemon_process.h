// granaryd as a child process, and mbpoll as its client.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace granary {

/// A program of its own with its output in files; killed at the end if it still runs.
class DaemonProcess {
 public:
  /// Starts granaryd with these arguments.
  /// @param folder gets stdout.txt and stderr.txt; its "state" is the daemon's $STATE_DIRECTORY, its "notify",
  ///   where there is one, the $NOTIFY_SOCKET
  /// @param listener a socket to hand over as systemd does; -1: none
  DaemonProcess(const std::filesystem::path& folder, const std::vector<std::string>& arguments, int listener = -1);
  ~DaemonProcess();
  DaemonProcess(const DaemonProcess&) = delete;
  DaemonProcess& operator=(const DaemonProcess&) = delete;

  void Signal(int signal) const;
  /// Waits for the end. @return the exit code; empty when it was killed, or still runs after two minutes
  std::optional<int> ExitCode();
  [[nodiscard]] bool Running();
  [[nodiscard]] std::string Stdout() const;
  [[nodiscard]] std::string Stderr() const;

 private:
  std::filesystem::path folder_;
  pid_t pid_ = -1;
  std::optional<int> status_;  // of waitpid, when it has ended
};

/// Polls `condition` until it holds. @return false when it did not within two minutes: far longer than a measurement
/// takes on a loaded machine, so that only a hang gets there
bool Eventually(const std::function<bool()>& condition);

/// A TCP port of 127.0.0.1 that nobody listens on now.
std::uint16_t FreePort();

/// True when mbpoll is installed.
bool HasMbpoll();
/// One value of unit 1 as mbpoll prints it; empty when it got no answer.
/// @param type as mbpoll has it: "4" one register, "4:int" and "4:float" two, high word first
std::optional<double> ReadModbus(std::uint16_t port, int address, const std::string& type);

}  // namespace granary
