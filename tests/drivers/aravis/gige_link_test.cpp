#include "drivers/gige_link.h"

#include <stdexcept>

#include <gtest/gtest.h>

namespace granary {
namespace {

TEST(PacketDelay_ns, LeavesTheOtherCameraTheTimeOfItsPacket) {
  // 1538 bytes on the wire take 12304 ns at 1 Gbit/s; at half of it the pause is as long.
  EXPECT_EQ(PacketDelay_ns(1500, 1000, 500), 12304);
}

TEST(PacketDelay_ns, IsNothingForACameraNoFasterThanItsShare) {
  EXPECT_EQ(PacketDelay_ns(1500, 1000, 1000), 0);
  EXPECT_EQ(PacketDelay_ns(1500, 1000, 4500), 0);
}

TEST(PacketDelay_ns, GrowsWithThePacket) { EXPECT_EQ(PacketDelay_ns(9000, 1000, 500), (9000 + 38) * 8); }

TEST(PacketDelay_ns, RefusesWhatIsNoLink) {
  EXPECT_THROW((void)PacketDelay_ns(0, 1000, 500), std::invalid_argument);
  EXPECT_THROW((void)PacketDelay_ns(1500, 0, 500), std::invalid_argument);
  EXPECT_THROW((void)PacketDelay_ns(1500, 1000, 0), std::invalid_argument);
}

TEST(LinkShare_mbps, KeepsATenthFree) { EXPECT_DOUBLE_EQ(2 * LinkShare_mbps(1000, 2), 900); }

TEST(LinkShare_mbps, FitsTwoCamerasOnTheLink) {
  const double share = LinkShare_mbps(1000, 2);
  const double packet_ns = (1500 + 38) * 8;  // at 1 Gbit/s
  const double period_ns = packet_ns + static_cast<double>(PacketDelay_ns(1500, 1000, share));
  EXPECT_LT(2 * packet_ns / period_ns, 0.91);
}

TEST(InterfaceTowards, FindsLoopbackWithItsPacketSizeAndNoSpeed) {
  const auto interface = InterfaceTowards("127.0.0.1");
  ASSERT_TRUE(interface);
  EXPECT_EQ(interface->name, "lo");
  EXPECT_GT(interface->mtu, 1000);
  EXPECT_FALSE(interface->speed_mbps);
}

TEST(InterfaceTowards, IsEmptyForWhatIsNoAddress) {
  EXPECT_FALSE(InterfaceTowards(""));
  EXPECT_FALSE(InterfaceTowards("camera-7"));
}

TEST(FrameIds, CountOnWhereSixteenBitsBeginAnewAtOne) {
  FrameIds ids;
  EXPECT_EQ(ids.Extend(65534), 65534u);
  EXPECT_EQ(ids.Extend(65535), 65535u);
  EXPECT_EQ(ids.Extend(1), 65536u);
  EXPECT_EQ(ids.Extend(2), 65537u);
}

TEST(FrameIds, CountOnThroughManyTurns) {
  FrameIds ids;
  for (std::uint64_t i = 0; i < 300'000; ++i) ASSERT_EQ(ids.Extend(i % 65535 + 1), i + 1);
}

TEST(FrameIds, LeaveGapsAsTheyAre) {
  FrameIds ids;
  (void)ids.Extend(65530);
  EXPECT_EQ(ids.Extend(5), 65540u);
  EXPECT_EQ(ids.Extend(1005), 66540u);
}

TEST(FrameIds, GoBackForAFrameThatComesLate) {
  FrameIds ids;
  (void)ids.Extend(65535);
  EXPECT_EQ(ids.Extend(2), 65537u);
  EXPECT_EQ(ids.Extend(65535), 65535u);
  EXPECT_EQ(ids.Extend(3), 65538u);
}

TEST(FrameIds, TakeSixtyFourBitsAsTheyAre) {
  FrameIds ids;
  for (std::uint64_t id = 65530; id < 65545; ++id) EXPECT_EQ(ids.Extend(id), id);
  EXPECT_EQ(ids.Extend(std::uint64_t{1} << 40), std::uint64_t{1} << 40);
}

TEST(FrameIds, BeginAtNoughtWhereTheCameraDoes) {
  FrameIds ids;
  EXPECT_EQ(ids.Extend(0), 0u);
  EXPECT_EQ(ids.Extend(1), 1u);
}

}  // namespace
}  // namespace granary
