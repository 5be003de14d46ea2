// Listening sockets that systemd opened for us (granaryd.socket), so that port 502 needs no privilege.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "daemon/modbus/socket.h"
#include "daemon/options.h"

namespace granary {

/// What systemd handed over, once: the environment that names the sockets is removed. Empty when there are none. Keep
/// them until the end: systemd holds them open as well, so that nobody can bind their addresses anew.
/// Main thread only, before other threads run.
/// @throws std::runtime_error when one of them is no listening TCP socket
[[nodiscard]] std::vector<FileDescriptor> InheritedListeners();

/// The inherited socket that is bound to this very end point (0.0.0.0 and [::] differ), or else a new one. May block
/// while a host name is looked up.
/// @return a descriptor of its own; `inherited` keeps its
/// @throws std::runtime_error that names address, port and cause
[[nodiscard]] FileDescriptor TakeListener(std::span<const FileDescriptor> inherited, const std::string& host,
                                          std::uint16_t port);

/// A socket on which nobody would answer is a fault of the configuration.
/// @param end_points all that the configuration listens on
/// @throws std::runtime_error that names the first inherited socket that is none of them
void RequireAllServed(std::span<const FileDescriptor> inherited, std::span<const HostPort> end_points);

}  // namespace granary
