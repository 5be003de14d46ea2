// Clients that no server should suffer from.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include <sys/types.h>

namespace granary::bench {

/// One way to misbehave. `act` has one go at the server from an address of 127.0.0.0/8, and is called again and again.
struct HostileKind {
  std::string_view name;
  void (*act)(const char* from, std::uint16_t port);
};

/// Half headers, drips, bad quantities, FC43, unread replies, connection floods, pipelined floods, random bytes.
[[nodiscard]] std::span<const HostileKind> HostileKinds();

/// A process with a thread for each of `kinds`; killed at the end. To be started by a process of one thread.
class HostileProcess {
 public:
  /// @throws std::system_error
  HostileProcess(std::span<const HostileKind> kinds, std::uint16_t port);
  ~HostileProcess();
  HostileProcess(const HostileProcess&) = delete;
  HostileProcess& operator=(const HostileProcess&) = delete;

 private:
  pid_t pid_;
};

}  // namespace granary::bench
