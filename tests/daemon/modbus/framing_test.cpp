#include "daemon/modbus/framing.h"

#include <cstdint>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

namespace granary {
namespace {

using Bytes = std::vector<std::uint8_t>;

const Bytes kRead{0x12, 0x34, 0, 0, 0, 6, 3, 3, 0, 10, 0, 2};

TEST(ParseFrame, FindsTransactionUnitAndPdu) {
  const auto frame = ParseFrame(kRead);
  ASSERT_EQ(frame.state, FrameState::kComplete);
  EXPECT_EQ(frame.transaction, 0x1234);
  EXPECT_EQ(frame.unit, 3);
  EXPECT_EQ(Bytes(frame.pdu.begin(), frame.pdu.end()), (Bytes{3, 0, 10, 0, 2}));
  EXPECT_EQ(frame.bytes, 12U);
}

TEST(ParseFrame, EveryPrefixIsIncomplete) {
  for (std::size_t size = 0; size < kRead.size(); ++size) {
    EXPECT_EQ(ParseFrame({kRead.data(), size}).state, FrameState::kIncomplete) << size;
  }
}

TEST(ParseFrame, LeavesThePipelinedFrameAlone) {
  Bytes two = kRead;
  two.insert(two.end(), kRead.begin(), kRead.end());
  EXPECT_EQ(ParseFrame(two).bytes, 12U);
}

TEST(ParseFrame, WrongProtocolIsMalformedAtItsFirstByte) {
  EXPECT_EQ(ParseFrame(Bytes{0, 1, 1}).state, FrameState::kMalformed);
  EXPECT_EQ(ParseFrame(Bytes{0, 1, 0, 1}).state, FrameState::kMalformed);
}

TEST(ParseFrame, LengthWithoutRoomForAFunctionIsMalformed) {
  EXPECT_EQ(ParseFrame(Bytes{0, 1, 0, 0, 0, 0}).state, FrameState::kMalformed);
  EXPECT_EQ(ParseFrame(Bytes{0, 1, 0, 0, 0, 1}).state, FrameState::kMalformed);
}

TEST(ParseFrame, LengthBeyondTheStandardIsMalformed) {
  EXPECT_EQ(ParseFrame(Bytes{0, 1, 0, 0, 0, 255}).state, FrameState::kMalformed);
  EXPECT_EQ(ParseFrame(Bytes{0, 1, 0, 0, 0, 254}).state, FrameState::kIncomplete);
}

TEST(AppendFrame, IsReadBackByParseFrame) {
  Bytes stream;
  AppendFrame(0xABCD, 7, Bytes{4, 2, 0, 1}, stream);
  const auto frame = ParseFrame(stream);
  ASSERT_EQ(frame.state, FrameState::kComplete);
  EXPECT_EQ(frame.transaction, 0xABCD);
  EXPECT_EQ(frame.unit, 7);
  EXPECT_EQ(frame.pdu.size(), 4U);
}

TEST(AppendFrame, RefusesAPduThatNoFrameHolds) {
  Bytes stream;
  EXPECT_THROW(AppendFrame(1, 1, Bytes(254), stream), std::length_error);
  EXPECT_THROW(AppendFrame(1, 1, Bytes{}, stream), std::length_error);
}

}  // namespace
}  // namespace granary
