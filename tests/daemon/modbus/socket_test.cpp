#include "daemon/modbus/socket.h"

#include <stdexcept>
#include <string>

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>

namespace granary {
namespace {

sockaddr_storage Peer(const std::string& address) {
  sockaddr_storage peer{};
  if (address.find(':') == std::string::npos) {
    auto& v4 = reinterpret_cast<sockaddr_in&>(peer);
    v4.sin_family = AF_INET;
    v4.sin_port = htons(40112);
    inet_pton(AF_INET, address.c_str(), &v4.sin_addr);
  } else {
    auto& v6 = reinterpret_cast<sockaddr_in6&>(peer);
    v6.sin6_family = AF_INET6;
    v6.sin6_port = htons(40112);
    inet_pton(AF_INET6, address.c_str(), &v6.sin6_addr);
  }
  return peer;
}

bool In(const std::string& network, const std::string& address) {
  return Contains(ParseNetwork(network).value(), Peer(address));
}

TEST(ParseNetwork, RefusesWhatIsNoNetwork) {
  for (const auto* text : {"", "depot", "10.0.0.0/33", "10.0.0.0/-1", "10.0.0.0/8x", "10.0.0/8", "::1/129", "/8"}) {
    EXPECT_FALSE(ParseNetwork(text)) << text;
  }
}

TEST(Contains, ComparesThePrefixOnly) {
  EXPECT_TRUE(In("192.168.7.0/24", "192.168.7.200"));
  EXPECT_FALSE(In("192.168.7.0/24", "192.168.8.200"));
  EXPECT_TRUE(In("192.168.6.0/23", "192.168.7.1"));
  EXPECT_FALSE(In("10.0.0.0/8", "127.0.0.1"));
}

TEST(Contains, BareAddressIsItselfOnly) {
  EXPECT_TRUE(In("10.1.2.3", "10.1.2.3"));
  EXPECT_FALSE(In("10.1.2.3", "10.1.2.4"));
}

TEST(Contains, ZeroPrefixIsEverybodyOfItsFamily) {
  EXPECT_TRUE(In("0.0.0.0/0", "8.8.8.8"));
  EXPECT_FALSE(In("0.0.0.0/0", "::1"));
  EXPECT_TRUE(In("::/0", "fe80::1"));
}

TEST(Contains, MappedPeerCountsAsIPv4) {
  EXPECT_TRUE(In("127.0.0.0/8", "::ffff:127.0.0.1"));
  EXPECT_FALSE(In("::/0", "::ffff:127.0.0.1"));
}

TEST(NameOf, PeerIsAddressAndPort) {
  EXPECT_EQ(NameOf(Peer("192.168.7.9")), "192.168.7.9:40112");
  EXPECT_EQ(NameOf(Peer("fe80::1")), "[fe80::1]:40112");
  EXPECT_EQ(NameOf(Peer("::ffff:10.0.0.1")), "10.0.0.1:40112");
}

TEST(ListenTcp, TakesAFreePortForZero) { EXPECT_GT(BoundPort(ListenTcp("127.0.0.1", 0).Get()), 0); }

TEST(ListenTcp, PortInUseIsOneErrorNamingAddressAndCause) {
  const auto first = ListenTcp("127.0.0.1", 0);
  const auto port = BoundPort(first.Get());
  try {
    (void)ListenTcp("127.0.0.1", port);
    FAIL() << "took a port in use";
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(std::string(error.what()), "cannot listen on 127.0.0.1:" + std::to_string(port) +
                                             ": Address already in use: another program listens there");
  }
}

TEST(ListenTcp, AddressOfNobodyIsNamed) {
  try {
    (void)ListenTcp("192.0.2.1", 1502);  // TEST-NET-1: no interface has it
    FAIL() << "bound to TEST-NET-1";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("cannot listen on 192.0.2.1:1502: "), std::string::npos);
  }
}

}  // namespace
}  // namespace granary
