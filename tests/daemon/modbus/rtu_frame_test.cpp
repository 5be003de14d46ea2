// Checksum, lengths and times against published frames and the standard's own numbers.
#include <chrono>
#include <cstdint>
#include <stdexcept>
#include <string_view>
#include <vector>

#include <gtest/gtest.h>

#include "daemon/modbus/rtu_frame.h"

namespace granary::test {
namespace {

using Bytes = std::vector<std::uint8_t>;
using namespace std::chrono_literals;

TEST(Crc16, MatchesThePublishedCheckValue) {
  constexpr std::string_view kDigits = "123456789";
  EXPECT_EQ(Crc16(Bytes(kDigits.begin(), kDigits.end())), 0x4B37);
}

TEST(Crc16, IsZeroOverAFrameWithItsChecksum) {
  EXPECT_EQ(Crc16(Bytes{0x11, 0x03, 0x00, 0x6B, 0x00, 0x03, 0x76, 0x87}), 0);
  EXPECT_EQ(Crc16(Bytes{0x02, 0x07, 0x41, 0x12}), 0);  // the example of Modbus over Serial Line, appendix B
}

TEST(RtuFrame, PutsTheChecksumLowByteFirst) {
  EXPECT_EQ(RtuFrame(1, Bytes{0x03, 0x00, 0x00, 0x00, 0x0A}), (Bytes{0x01, 0x03, 0x00, 0x00, 0x00, 0x0A, 0xC5, 0xCD}));
}

TEST(RtuFrame, RefusesAPduThatDoesNotFit) {
  EXPECT_THROW(static_cast<void>(RtuFrame(1, Bytes{})), std::length_error);
  EXPECT_THROW(static_cast<void>(RtuFrame(1, Bytes(254, 3))), std::length_error);
  EXPECT_EQ(RtuFrame(1, Bytes(253, 3)).size(), kMaxRtuBytes);
}

TEST(TimingOf, IsInCharactersUpTo19200) {
  EXPECT_EQ(TimingOf(9600).character, 1145833ns);
  EXPECT_EQ(TimingOf(9600).t15, 1718749ns);
  EXPECT_EQ(TimingOf(19200).t35, 2005206ns);
}

TEST(TimingOf, IsFixedAbove19200) {
  for (const int baud : {38400, 57600, 115200}) {
    EXPECT_EQ(TimingOf(baud).t15, 750us);
    EXPECT_EQ(TimingOf(baud).t35, 1750us);
  }
  EXPECT_EQ(TimingOf(115200).character, 95486ns);
}

TEST(RequestBytes, AreFixedByMostFunctions) {
  for (const std::uint8_t function : {1, 2, 3, 4, 5, 6, 8}) EXPECT_EQ(RequestBytes(Bytes{3, function}), 8U);
  for (const std::uint8_t function : {7, 11, 12, 17}) EXPECT_EQ(RequestBytes(Bytes{3, function}), 4U);
  EXPECT_EQ(RequestBytes(Bytes{3, 22}), 10U);
  EXPECT_EQ(RequestBytes(Bytes{3, 24}), 6U);
  EXPECT_EQ(RequestBytes(Bytes{3, 43, 14}), 7U);
}

TEST(RequestBytes, AreCountedByTheOthers) {
  EXPECT_EQ(RequestBytes(Bytes{3, 16, 0, 0, 0, 2, 4}), 13U);
  EXPECT_EQ(RequestBytes(Bytes{3, 23, 0, 0, 0, 2, 0, 0, 0, 1, 2}), 15U);
  EXPECT_EQ(RequestBytes(Bytes{3, 20, 7}), 12U);
}

TEST(RequestBytes, AreMoreThanThereAreBeforeTheCount) {
  const Bytes request{3, 16, 0, 0, 0, 2};
  for (std::size_t n = 1; n <= request.size(); ++n) {
    EXPECT_GT(RequestBytes(std::span(request).first(n)), n);
  }
}

TEST(RequestBytes, AreNoneForUnknownFunctionsAndFramesTooLong) {
  EXPECT_EQ(RequestBytes(Bytes{3, 65}), 0U);
  EXPECT_EQ(RequestBytes(Bytes{3, 0x83}), 0U);
  EXPECT_EQ(RequestBytes(Bytes{3, 43, 13}), 0U);
  EXPECT_EQ(RequestBytes(Bytes{3, 16, 0, 0, 0, 125, 250}), 0U);
}

TEST(ReplyBytes, AreCountedOrFixed) {
  EXPECT_EQ(ReplyBytes(Bytes{7, 3, 4}), 9U);
  EXPECT_EQ(ReplyBytes(Bytes{7, 16}), 8U);
  EXPECT_EQ(ReplyBytes(Bytes{7, 7}), 5U);
  EXPECT_EQ(ReplyBytes(Bytes{7, 22}), 10U);
  EXPECT_EQ(ReplyBytes(Bytes{7, 24, 0, 6}), 12U);
}

TEST(ReplyBytes, OfAnExceptionAreFive) { EXPECT_EQ(ReplyBytes(Bytes{7, 0x83, 2}), 5U); }

TEST(ReplyBytes, FollowTheObjectsOfAnIdentification) {
  const Bytes reply{7, 43, 14, 1, 1, 0, 0, 2, 0, 3, 'a', 'b', 'c', 1, 1, 'd', 0, 0};
  EXPECT_EQ(ReplyBytes(reply), reply.size());
  for (std::size_t n = 1; n < 15; ++n) EXPECT_GT(ReplyBytes(std::span(reply).first(n)), n);
}

TEST(ReplyBytes, AreNoneWhenObjectsRunPastAFrame) {
  EXPECT_EQ(ReplyBytes(Bytes{7, 43, 14, 1, 1, 0, 0, 2, 0, 250, 'a'}), 0U);
}

}  // namespace
}  // namespace granary::test
