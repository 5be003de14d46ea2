// What a GigE Vision link carries, and how frames are counted on it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace granary {

struct NetworkInterface {
  std::string name;
  int mtu = 0;                    ///< bytes of an IP packet
  std::optional<int> speed_mbps;  ///< empty where the kernel does not know it: lo, virtual ones
};

/// The interface over which packets to `ipv4` leave; empty when there is no way there.
[[nodiscard]] std::optional<NetworkInterface> InterfaceTowards(const std::string& ipv4);

/// The pause that a camera has to make after each packet to take no more than its share of the link.
/// @param packet_size bytes with IP, UDP and GVSP headers, as GevSCPSPacketSize counts them
/// @param camera_mbps how fast the camera itself sends, Mbit/s
/// @param share_mbps  what it may take on average, Mbit/s
/// @return nanoseconds; 0 when the camera is no faster than its share
/// @throws std::invalid_argument unless all are more than 0
[[nodiscard]] std::int64_t PacketDelay_ns(int packet_size, double camera_mbps, double share_mbps);

/// What of a link of `link_mbps` each of `cameras` may take: a tenth stays free for commands and packets sent again.
[[nodiscard]] double LinkShare_mbps(double link_mbps, int cameras);

/// Counts frames on where a camera's ids of 16 bits begin anew. GigE Vision goes from 65535 to 1.
class FrameIds {
 public:
  /// The id in 64 bits: the nearest to the one before, so that a frame that comes late or a gap does no harm.
  [[nodiscard]] std::uint64_t Extend(std::uint64_t id);

 private:
  std::optional<std::uint64_t> last_;
  bool wide_ = false;  ///< the camera counts in 64 bits itself
};

}  // namespace granary
