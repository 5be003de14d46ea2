#include "daemon/inherited_sockets.h"

#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

namespace granary {
namespace {

/// In a child of its own, as systemd would start it: `socket` becomes descriptor 3. 0 when all is as claimed.
int ExitOfInheriting(int socket, int (*claim)(const std::vector<FileDescriptor>&)) {
  if (socket != 3 && dup2(socket, 3) != 3) return 100;
  setenv("LISTEN_PID", std::to_string(getpid()).c_str(), 1);
  setenv("LISTEN_FDS", "1", 1);
  try {
    return claim(InheritedListeners());
  } catch (const std::exception& error) {
    fputs(error.what(), stderr);
    return 101;
  }
}

std::vector<FileDescriptor> Listeners(const char* host) {
  std::vector<FileDescriptor> listeners;
  listeners.push_back(ListenTcp(host, 0));
  return listeners;
}

std::string FaultOf(const std::vector<FileDescriptor>& inherited, const std::vector<HostPort>& end_points) {
  try {
    RequireAllServed(inherited, end_points);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return {};
}

TEST(InheritedListeners, IsEmptyOutsideOfSystemd) {
  unsetenv("LISTEN_PID");
  EXPECT_TRUE(InheritedListeners().empty());
}

TEST(InheritedListeners, AreWhatSystemdHandsOver) {
  const auto listener = ListenTcp("127.0.0.1", 0);
  EXPECT_EXIT(_exit(ExitOfInheriting(
                  listener.Get(),
                  [](const auto& inherited) { return inherited.size() == 1 && inherited[0].Get() == 3 ? 0 : 1; })),
              ::testing::ExitedWithCode(0), "");
}

TEST(InheritedListeners, EnvironmentIsNotPassedOn) {
  const auto listener = ListenTcp("127.0.0.1", 0);
  EXPECT_EXIT(
      _exit(ExitOfInheriting(listener.Get(), [](const auto&) { return getenv("LISTEN_FDS") == nullptr ? 0 : 1; })),
      ::testing::ExitedWithCode(0), "");
}

TEST(InheritedListeners, DatagramSocketIsRefused) {
  const FileDescriptor datagrams(socket(AF_INET, SOCK_DGRAM, 0));
  EXPECT_EXIT(_exit(ExitOfInheriting(datagrams.Get(), [](const auto&) { return 0; })), ::testing::ExitedWithCode(101),
              "descriptor 3 from systemd is no listening TCP socket");
}

TEST(TakeListener, EndPointUsesTheInheritedSocket) {
  const auto inherited = Listeners("127.0.0.1");
  const std::uint16_t port = BoundPort(inherited[0].Get());
  // Binding anew would fail: the port is in use.
  EXPECT_EQ(BoundPort(TakeListener(inherited, "127.0.0.1", port).Get()), port);
}

TEST(TakeListener, NameIsResolvedBeforeItIsCompared) {
  const auto inherited = Listeners("127.0.0.1");
  const std::uint16_t port = BoundPort(inherited[0].Get());
  EXPECT_EQ(BoundPort(TakeListener(inherited, "0177.0.0.1", port).Get()), port);
}

TEST(TakeListener, InheritedSocketCanBeTakenAgainAfterAReload) {
  const auto inherited = Listeners("127.0.0.1");
  const std::uint16_t port = BoundPort(inherited[0].Get());
  { const auto before = TakeListener(inherited, "127.0.0.1", port); }
  EXPECT_EQ(BoundPort(TakeListener(inherited, "127.0.0.1", port).Get()), port);
}

TEST(TakeListener, OtherAddressIsListenedOnAnew) {
  const auto inherited = Listeners("127.0.0.1");
  const auto taken = TakeListener(inherited, "127.0.0.2", BoundPort(inherited[0].Get()));
  EXPECT_EQ(NameOf(BoundAddress(taken.Get())), "127.0.0.2:" + std::to_string(BoundPort(inherited[0].Get())));
}

TEST(TakeListener, AnyIPv6IsNotAnyIPv4) {
  const auto inherited = Listeners("0.0.0.0");
  // The port is taken for IPv4, so that a socket for both cannot be bound: it was not mistaken for the inherited one.
  EXPECT_THROW((void)TakeListener(inherited, "::", BoundPort(inherited[0].Get())), std::runtime_error);
}

TEST(RequireAllServed, SocketThatNoKeyNamesIsNamed) {
  const auto inherited = Listeners("127.0.0.1");
  const std::uint16_t port = BoundPort(inherited[0].Get());
  EXPECT_THAT(FaultOf(inherited, {{"127.0.0.2", port}}),
              ::testing::StartsWith("systemd listens on 127.0.0.1:" + std::to_string(port) +
                                    " for us, which no key names: set listen of [modbus.tcp]"));
}

TEST(RequireAllServed, SocketThatAKeyNamesIsWell) {
  const auto inherited = Listeners("127.0.0.1");
  EXPECT_EQ(FaultOf(inherited, {{"127.0.0.2", 502}, {"127.0.0.1", BoundPort(inherited[0].Get())}}), "");
}

}  // namespace
}  // namespace granary
