// The calls of the socket API that the server needs, each checked on its line and named in the error.
#include "daemon/modbus/socket.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <system_error>

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <unistd.h>

namespace granary {
namespace {

std::string CauseOf(int error, std::uint16_t port) {
  std::string cause = std::generic_category().message(error);
  if (error == EADDRINUSE) cause += ": another program listens there";
  if (error == EADDRNOTAVAIL) cause += ": no interface has this address";
  if (error == EACCES && port < 1024) cause += ": ports below 1024 need CAP_NET_BIND_SERVICE";
  return cause;
}

/// The bytes of an address, IPv4-mapped IPv6 unwrapped; family 0 when it is neither.
Network HostOf(const sockaddr_storage& peer) {
  Network host{.family = 0};
  if (peer.ss_family == AF_INET) {
    const auto& v4 = reinterpret_cast<const sockaddr_in&>(peer);
    host.family = AF_INET;
    std::memcpy(host.address.data(), &v4.sin_addr, 4);
  } else if (peer.ss_family == AF_INET6) {
    const auto& v6 = reinterpret_cast<const sockaddr_in6&>(peer);
    if (IN6_IS_ADDR_V4MAPPED(&v6.sin6_addr)) {
      host.family = AF_INET;
      std::memcpy(host.address.data(), v6.sin6_addr.s6_addr + 12, 4);
    } else {
      host.family = AF_INET6;
      std::memcpy(host.address.data(), v6.sin6_addr.s6_addr, 16);
    }
  }
  return host;
}

}  // namespace

FileDescriptor::~FileDescriptor() {
  if (fd_ >= 0) close(fd_);
}

FileDescriptor ListenTcp(const std::string& host, std::uint16_t port) {
  const auto fail = [&](const std::string& cause) -> std::runtime_error {
    const std::string shown = host.find(':') == std::string::npos ? host : "[" + host + "]";
    return std::runtime_error("cannot listen on " + shown + ":" + std::to_string(port) + ": " + cause);
  };
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
  addrinfo* found = nullptr;
  if (const int error = getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found); error != 0) {
    throw fail(gai_strerror(error));
  }
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> list(found, &freeaddrinfo);

  FileDescriptor listener(socket(list->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (listener.Get() < 0) throw fail(CauseOf(errno, port));
  const int on = 1, off = 0;
  // Without SO_REUSEADDR a restart fails for as long as old connections linger in TIME_WAIT.
  if (setsockopt(listener.Get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0) throw fail(CauseOf(errno, port));
  if (list->ai_family == AF_INET6 && setsockopt(listener.Get(), IPPROTO_IPV6, IPV6_V6ONLY, &off, sizeof off) != 0) {
    throw fail(CauseOf(errno, port));
  }
  if (bind(listener.Get(), list->ai_addr, list->ai_addrlen) != 0) throw fail(CauseOf(errno, port));
  if (listen(listener.Get(), SOMAXCONN) != 0) throw fail(CauseOf(errno, port));
  return listener;
}

std::uint16_t BoundPort(int socket) {
  sockaddr_storage bound{};
  socklen_t size = sizeof bound;
  if (getsockname(socket, reinterpret_cast<sockaddr*>(&bound), &size) != 0) {
    throw std::system_error(errno, std::generic_category(), "getsockname");
  }
  return ntohs(bound.ss_family == AF_INET6 ? reinterpret_cast<const sockaddr_in6&>(bound).sin6_port
                                           : reinterpret_cast<const sockaddr_in&>(bound).sin_port);
}

std::optional<Network> ParseNetwork(std::string_view text) {
  const auto slash = text.find('/');
  const std::string address(text.substr(0, slash));
  Network network;
  network.family = address.find(':') == std::string::npos ? AF_INET : AF_INET6;
  if (inet_pton(network.family, address.c_str(), network.address.data()) != 1) return std::nullopt;
  const int widest = network.family == AF_INET ? 32 : 128;
  network.prefix_bits = widest;
  if (slash != std::string_view::npos) {
    const std::string_view prefix = text.substr(slash + 1);
    const auto [end, error] = std::from_chars(prefix.data(), prefix.data() + prefix.size(), network.prefix_bits);
    if (error != std::errc{} || end != prefix.data() + prefix.size()) return std::nullopt;
    if (network.prefix_bits < 0 || network.prefix_bits > widest) return std::nullopt;
  }
  return network;
}

bool Contains(const Network& network, const sockaddr_storage& peer) {
  const Network host = HostOf(peer);
  if (host.family != network.family) return false;
  for (int bit = 0; bit < network.prefix_bits; bit += 8) {
    const int used = std::min(8, network.prefix_bits - bit);
    const auto mask = static_cast<std::uint8_t>(0xFF << (8 - used));
    if ((host.address[bit / 8] & mask) != (network.address[bit / 8] & mask)) return false;
  }
  return true;
}

std::string NameOf(const sockaddr_storage& peer) {
  const Network host = HostOf(peer);
  std::array<char, INET6_ADDRSTRLEN> text{};
  if (inet_ntop(host.family, host.address.data(), text.data(), text.size()) == nullptr) return "unknown";
  // sin_port and sin6_port share their place.
  const std::string port = std::to_string(ntohs(reinterpret_cast<const sockaddr_in&>(peer).sin_port));
  std::string name = text.data();
  if (host.family == AF_INET6) name.insert(0, 1, '[').push_back(']');
  return name.append(":").append(port);
}

}  // namespace granary
