// Sockets: an owned descriptor, a listener, and the networks that may connect.
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include <sys/socket.h>

namespace granary {

/// Owns one file descriptor.
class FileDescriptor {
 public:
  FileDescriptor() = default;
  explicit FileDescriptor(int fd) : fd_(fd) {}
  FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~FileDescriptor();
  [[nodiscard]] int Get() const { return fd_; }

 private:
  int fd_ = -1;
};

/// Takes what `call` returned. @throws std::system_error with errno, naming the call, when it is no descriptor
[[nodiscard]] FileDescriptor Checked(int fd, const char* call);

/// Binds and listens. May block while a host name is looked up.
/// @param host name or address, an IPv6 one without brackets; "::" takes IPv4 too
/// @param port 0 takes a free one
/// @throws std::runtime_error that names address, port and cause
[[nodiscard]] FileDescriptor ListenTcp(const std::string& host, std::uint16_t port);

/// Where ListenTcp would bind. @throws std::runtime_error that names address, port and cause
[[nodiscard]] sockaddr_storage ResolveListener(const std::string& host, std::uint16_t port);

/// The address that a socket is bound to. @throws std::system_error
[[nodiscard]] sockaddr_storage BoundAddress(int socket);
/// The port that a socket is bound to. @throws std::system_error
[[nodiscard]] std::uint16_t BoundPort(int socket);

/// What every connection accepted from `listener` from now on gets from the kernel: never blocks, sends at once, holds
/// little unsent, and a peer that vanished is known within a minute. @throws std::system_error
void PrepareListener(int listener);

/// A network in CIDR notation.
struct Network {
  int family = AF_INET;                    ///< AF_INET or AF_INET6
  std::array<std::uint8_t, 16> address{};  ///< the first 4 bytes for IPv4
  int prefix_bits = 0;
  auto operator<=>(const Network&) const = default;
};

/// Reads "10.0.0.0/8", "::1/128" or a bare address; empty when it is neither.
[[nodiscard]] std::optional<Network> ParseNetwork(std::string_view text);
/// Whether a peer lies inside; an IPv4 peer of an IPv6 socket counts as IPv4.
[[nodiscard]] bool Contains(const Network& network, const sockaddr_storage& peer);

/// A peer's address without its port, as a network of that one host; an IPv4 peer of an IPv6 socket counts as IPv4.
[[nodiscard]] Network HostOf(const sockaddr_storage& peer);

/// "192.168.7.9:40112", for logs.
[[nodiscard]] std::string NameOf(const sockaddr_storage& peer);

}  // namespace granary
