// Two GigE cameras need two addresses, and lo has the second one only where somebody gives it to it: in a namespace of
// its own anybody may.
#include "tests/loopback/network_namespace.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "daemon/modbus/socket.h"

namespace granary {
namespace {

std::string Failed(const std::string& what) {
  return "no network namespace of our own: " + what + ": " + std::strerror(errno);
}

bool WriteFile(const char* file, const std::string& text) {
  const FileDescriptor out(open(file, O_WRONLY | O_CLOEXEC));
  return out.Get() >= 0 && write(out.Get(), text.data(), text.size()) == static_cast<ssize_t>(text.size());
}

ifreq RequestFor(const char* interface) {
  ifreq request{};
  std::strncpy(request.ifr_name, interface, IFNAMSIZ - 1);
  return request;
}

std::string Enter() {
  const std::string uid = std::to_string(getuid()), gid = std::to_string(getgid());
  if (unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) return Failed("unshare");
  if (!WriteFile("/proc/self/setgroups", "deny")) return Failed("setgroups");
  if (!WriteFile("/proc/self/uid_map", "0 " + uid + " 1")) return Failed("uid_map");
  if (!WriteFile("/proc/self/gid_map", "0 " + gid + " 1")) return Failed("gid_map");

  const FileDescriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (socket.Get() < 0) return Failed("socket");
  ifreq up = RequestFor("lo");
  up.ifr_flags = IFF_UP | IFF_RUNNING;
  if (ioctl(socket.Get(), SIOCSIFFLAGS, &up) != 0) return Failed("lo up");
  ifreq second = RequestFor("lo:2");
  sockaddr_in address{};
  address.sin_family = AF_INET;
  inet_pton(AF_INET, "127.0.0.2", &address.sin_addr);
  std::memcpy(&second.ifr_addr, &address, sizeof address);
  if (ioctl(socket.Get(), SIOCSIFADDR, &second) != 0) return Failed("127.0.0.2 on lo");
  return {};
}

}  // namespace

std::string EnterNetworkNamespace() {
  static const std::string why_not = Enter();
  return why_not;
}

}  // namespace granary
