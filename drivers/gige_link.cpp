// Arithmetic of packets, and two questions to the kernel: which interface leads to a camera, and how fast that is.
#include "drivers/gige_link.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <memory>
#include <stdexcept>

namespace granary {
namespace {

// Preamble 8, Ethernet header 14, checksum 4, gap 12 bytes. Source: IEEE 802.3.
constexpr int kEthernetBytes = 38;
constexpr std::uint64_t kIdPeriod = 65535;

class Socket {
 public:
  Socket() : fd_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {}
  ~Socket() {
    if (fd_ >= 0) ::close(fd_);
  }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  [[nodiscard]] int fd() const { return fd_; }

 private:
  int fd_;
};

/// Our own address on the way to `remote`: connecting a datagram socket asks the routes and sends nothing.
std::optional<in_addr> AddressTowards(const Socket& socket, const in_addr& remote) {
  sockaddr_in there{};
  there.sin_family = AF_INET;
  there.sin_port = htons(9);
  there.sin_addr = remote;
  sockaddr_in here{};
  socklen_t length = sizeof here;
  if (::connect(socket.fd(), reinterpret_cast<const sockaddr*>(&there), sizeof there) != 0) return std::nullopt;
  if (::getsockname(socket.fd(), reinterpret_cast<sockaddr*>(&here), &length) != 0) return std::nullopt;
  return here.sin_addr;
}

std::string NameOf(const in_addr& own) {
  ifaddrs* first = nullptr;
  if (::getifaddrs(&first) != 0) return "";
  const std::unique_ptr<ifaddrs, decltype(&::freeifaddrs)> owner(first, &::freeifaddrs);
  for (const ifaddrs* entry = first; entry != nullptr; entry = entry->ifa_next) {
    if (entry->ifa_addr == nullptr || entry->ifa_addr->sa_family != AF_INET) continue;
    sockaddr_in address{};
    std::memcpy(&address, entry->ifa_addr, sizeof address);
    if (address.sin_addr.s_addr == own.s_addr) return entry->ifa_name;
  }
  return "";
}

}  // namespace

std::optional<NetworkInterface> InterfaceTowards(const std::string& ipv4) {
  in_addr remote{};
  if (::inet_pton(AF_INET, ipv4.c_str(), &remote) != 1) return std::nullopt;
  const Socket socket;
  if (socket.fd() < 0) return std::nullopt;
  const auto own = AddressTowards(socket, remote);
  if (!own) return std::nullopt;
  NetworkInterface interface;
  interface.name = NameOf(*own);
  if (interface.name.empty() || interface.name.size() >= IFNAMSIZ) return std::nullopt;

  ifreq request{};
  std::memcpy(request.ifr_name, interface.name.c_str(), interface.name.size());
  if (::ioctl(socket.fd(), SIOCGIFMTU, &request) != 0) return std::nullopt;
  interface.mtu = request.ifr_mtu;
  // -1 or no number at all where the link is down or has no speed.
  int speed = 0;
  if (std::ifstream("/sys/class/net/" + interface.name + "/speed") >> speed && speed > 0) interface.speed_mbps = speed;
  return interface;
}

std::int64_t PacketDelay_ns(int packet_size, double camera_mbps, double share_mbps) {
  if (packet_size <= 0 || !(camera_mbps > 0) || !(share_mbps > 0)) {
    throw std::invalid_argument("PacketDelay_ns: packet size and speeds must be more than 0");
  }
  const double bits = 8.0 * (packet_size + kEthernetBytes);
  return std::max(0L, std::lround(1000 * (bits / share_mbps - bits / camera_mbps)));
}

double LinkShare_mbps(double link_mbps, int cameras) { return 0.9 * link_mbps / cameras; }

std::uint64_t FrameIds::Extend(std::uint64_t id) {
  wide_ = wide_ || id > kIdPeriod;
  if (!last_ || wide_) return *(last_ = id);
  const auto last_id = static_cast<std::int64_t>(*last_ == 0 ? 0 : (*last_ - 1) % kIdPeriod + 1);
  constexpr auto kHalf = static_cast<std::int64_t>(kIdPeriod / 2);
  auto step = static_cast<std::int64_t>(id) - last_id;
  if (step < -kHalf) step += static_cast<std::int64_t>(kIdPeriod);
  if (step > kHalf && *last_ > kIdPeriod) step -= static_cast<std::int64_t>(kIdPeriod);
  return *(last_ = *last_ + static_cast<std::uint64_t>(step));
}

}  // namespace granary
