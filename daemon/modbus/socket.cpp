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
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
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

void SetOption(int socket, int level, int option, int value, const char* name) {
  if (setsockopt(socket, level, option, &value, sizeof value) != 0) {
    throw std::system_error(errno, std::generic_category(), std::string("setsockopt ") + name);
  }
}

std::runtime_error CannotListen(const std::string& host, std::uint16_t port, const std::string& cause) {
  const std::string shown = host.find(':') == std::string::npos ? host : "[" + host + "]";
  return std::runtime_error("cannot listen on " + shown + ":" + std::to_string(port) + ": " + cause);
}

}  // namespace

FileDescriptor::~FileDescriptor() {
  if (fd_ >= 0) close(fd_);
}

sockaddr_storage ResolveListener(const std::string& host, std::uint16_t port) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
  addrinfo* found = nullptr;
  if (const int error = getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found); error != 0) {
    throw CannotListen(host, port, gai_strerror(error));
  }
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> list(found, &freeaddrinfo);
  sockaddr_storage address{};
  std::memcpy(&address, list->ai_addr, list->ai_addrlen);
  return address;
}

FileDescriptor Checked(int fd, const char* call) {
  if (fd < 0) throw std::system_error(errno, std::generic_category(), call);
  return FileDescriptor(fd);
}

FileDescriptor ListenTcp(const std::string& host, std::uint16_t port) {
  const sockaddr_storage address = ResolveListener(host, port);
  const auto fail = [&] { return CannotListen(host, port, CauseOf(errno, port)); };
  FileDescriptor listener(socket(address.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (listener.Get() < 0) throw fail();
  const int on = 1, off = 0;
  // Without SO_REUSEADDR a restart fails for as long as old connections linger in TIME_WAIT.
  if (setsockopt(listener.Get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0) throw fail();
  if (address.ss_family == AF_INET6 && setsockopt(listener.Get(), IPPROTO_IPV6, IPV6_V6ONLY, &off, sizeof off) != 0) {
    throw fail();
  }
  const socklen_t size = address.ss_family == AF_INET6 ? sizeof(sockaddr_in6) : sizeof(sockaddr_in);
  if (bind(listener.Get(), reinterpret_cast<const sockaddr*>(&address), size) != 0) throw fail();
  if (listen(listener.Get(), SOMAXCONN) != 0) throw fail();
  return listener;
}

sockaddr_storage BoundAddress(int socket) {
  sockaddr_storage bound{};
  socklen_t size = sizeof bound;
  if (getsockname(socket, reinterpret_cast<sockaddr*>(&bound), &size) != 0) {
    throw std::system_error(errno, std::generic_category(), "getsockname");
  }
  return bound;
}

std::uint16_t BoundPort(int socket) {
  const sockaddr_storage bound = BoundAddress(socket);
  // sin_port and sin6_port share their place.
  return ntohs(reinterpret_cast<const sockaddr_in&>(bound).sin_port);
}

void PrepareListener(int listener) {
  const int flags = fcntl(listener, F_GETFL);
  if (flags < 0 || fcntl(listener, F_SETFL, flags | O_NONBLOCK) < 0) {
    throw std::system_error(errno, std::generic_category(), "fcntl O_NONBLOCK");
  }
  // Linux hands these on to accepted sockets. Set here they cost a flood of newcomers nothing.
  SetOption(listener, SOL_SOCKET, SO_KEEPALIVE, 1, "SO_KEEPALIVE");
  SetOption(listener, SOL_SOCKET, SO_SNDBUF, 64 * 1024, "SO_SNDBUF");    // for clients that never read
  SetOption(listener, IPPROTO_TCP, TCP_KEEPIDLE, 20, "TCP_KEEPIDLE");    // seconds
  SetOption(listener, IPPROTO_TCP, TCP_KEEPINTVL, 10, "TCP_KEEPINTVL");  // seconds
  SetOption(listener, IPPROTO_TCP, TCP_KEEPCNT, 3, "TCP_KEEPCNT");
  SetOption(listener, IPPROTO_TCP, TCP_USER_TIMEOUT, 20000, "TCP_USER_TIMEOUT");  // ms, for data not acknowledged
  SetOption(listener, IPPROTO_TCP, TCP_NODELAY, 1, "TCP_NODELAY");
}

Network HostOf(const sockaddr_storage& peer) {
  Network host{.family = 0};
  if (peer.ss_family == AF_INET) {
    const auto& v4 = reinterpret_cast<const sockaddr_in&>(peer);
    host = {.family = AF_INET, .prefix_bits = 32};
    std::memcpy(host.address.data(), &v4.sin_addr, 4);
  } else if (peer.ss_family == AF_INET6) {
    const auto& v6 = reinterpret_cast<const sockaddr_in6&>(peer);
    if (IN6_IS_ADDR_V4MAPPED(&v6.sin6_addr)) {
      host = {.family = AF_INET, .prefix_bits = 32};
      std::memcpy(host.address.data(), v6.sin6_addr.s6_addr + 12, 4);
    } else {
      host = {.family = AF_INET6, .prefix_bits = 128};
      std::memcpy(host.address.data(), v6.sin6_addr.s6_addr, 16);
    }
  }
  return host;
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
