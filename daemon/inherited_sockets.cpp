// Socket activation, sd_listen_fds(3). A socket is told by the address that it is bound to, which is what the
// configuration names as well; the names of units would be a second thing to keep in step.
#include "daemon/inherited_sockets.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>
#include <utility>

#include <fcntl.h>
#include <netinet/in.h>
#include <systemd/sd-daemon.h>

namespace granary {
namespace {

bool IsSame(const sockaddr_storage& a, const sockaddr_storage& b) {
  if (a.ss_family != b.ss_family) return false;
  if (a.ss_family == AF_INET6) {
    const auto &first = reinterpret_cast<const sockaddr_in6&>(a), &second = reinterpret_cast<const sockaddr_in6&>(b);
    return first.sin6_port == second.sin6_port && std::memcmp(&first.sin6_addr, &second.sin6_addr, 16) == 0;
  }
  const auto &first = reinterpret_cast<const sockaddr_in&>(a), &second = reinterpret_cast<const sockaddr_in&>(b);
  return first.sin_port == second.sin_port && first.sin_addr.s_addr == second.sin_addr.s_addr;
}

bool ListensOnTcp(int socket) {
  return sd_is_socket_inet(socket, AF_INET, SOCK_STREAM, 1, 0) > 0 ||
         sd_is_socket_inet(socket, AF_INET6, SOCK_STREAM, 1, 0) > 0;
}

}  // namespace

std::vector<FileDescriptor> InheritedListeners() {
  const int count = sd_listen_fds(1);
  if (count < 0) throw std::system_error(-count, std::generic_category(), "sd_listen_fds");
  std::vector<FileDescriptor> inherited;
  for (int fd = SD_LISTEN_FDS_START; fd < SD_LISTEN_FDS_START + count; ++fd) inherited.emplace_back(fd);
  for (const auto& socket : inherited) {
    if (!ListensOnTcp(socket.Get())) {
      throw std::runtime_error("descriptor " + std::to_string(socket.Get()) +
                               " from systemd is no listening TCP socket; must be one: see ListenStream= and Accept=no "
                               "in systemd.socket(5)");
    }
  }
  return inherited;
}

FileDescriptor TakeListener(std::span<const FileDescriptor> inherited, const std::string& host, std::uint16_t port) {
  const sockaddr_storage wanted = ResolveListener(host, port);
  for (const auto& socket : inherited) {
    if (!IsSame(BoundAddress(socket.Get()), wanted)) continue;
    FileDescriptor taken(fcntl(socket.Get(), F_DUPFD_CLOEXEC, 0));
    if (taken.Get() < 0) throw std::system_error(errno, std::generic_category(), "fcntl F_DUPFD_CLOEXEC");
    return taken;
  }
  return ListenTcp(host, port);
}

void RequireAllServed(std::span<const FileDescriptor> inherited, std::span<const HostPort> end_points) {
  std::vector<sockaddr_storage> served;
  for (const auto& end_point : end_points) served.push_back(ResolveListener(end_point.host, end_point.port));
  for (const auto& socket : inherited) {
    const sockaddr_storage bound = BoundAddress(socket.Get());
    if (std::any_of(served.begin(), served.end(), [&](const auto& address) { return IsSame(address, bound); }))
      continue;
    throw std::runtime_error("systemd listens on " + NameOf(bound) +
                             " for us, which no key names: set listen of [modbus.tcp] or [modbus.tls] to it, or change "
                             "ListenStream= of granaryd.socket");
  }
}

}  // namespace granary
