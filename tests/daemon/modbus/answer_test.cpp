#include "daemon/modbus/answer.h"

#include <string>

#include <gtest/gtest.h>

#include "daemon/modbus/framing.h"
#include "daemon/modbus/status.h"
#include "tests/daemon/modbus/snapshots.h"

namespace granary {
namespace {

Pdu Ask(const Pdu& request, const BinSnapshot& snapshot = test::GoodSnapshot(),
        const ModbusIdentity& identity = test::kIdentity) {
  const auto image = EncodeRegisters({snapshot, test::kMeasuredAt, identity, {}});
  return AnswerRequest(request, {image, CoilBits(snapshot), identity, snapshot.bin});
}

Pdu Read(std::uint8_t function, int address, int count) {
  return {function, static_cast<std::uint8_t>(address >> 8), static_cast<std::uint8_t>(address),
          static_cast<std::uint8_t>(count >> 8), static_cast<std::uint8_t>(count)};
}

TEST(AnswerRequest, ReadsTheSameRegistersUnderThreeAndFour) {
  auto three = Ask(Read(3, 0, 65)), four = Ask(Read(4, 0, 65));
  ASSERT_EQ(three.size(), 2U + 130U);
  EXPECT_EQ(three[0], 3);
  EXPECT_EQ(four[0], 4);
  EXPECT_EQ(Pdu(three.begin() + 1, three.end()), Pdu(four.begin() + 1, four.end()));
}

TEST(AnswerRequest, RegisterGoesHighByteFirst) { EXPECT_EQ(Ask(Read(3, 58, 2)), (Pdu{3, 4, 0xDE, 0xAD, 0xBE, 0xEF})); }

TEST(AnswerRequest, LastAddressCanBeReadAndTheNextCannot) {
  EXPECT_EQ(Ask(Read(3, 3999, 1)), (Pdu{3, 2, 0, 0}));
  EXPECT_EQ(Ask(Read(3, 3999, 2)), (Pdu{0x83, 2}));
  EXPECT_EQ(Ask(Read(3, 4000, 1)), (Pdu{0x83, 2}));
  EXPECT_EQ(Ask(Read(3, 65535, 125)), (Pdu{0x83, 2}));
}

TEST(AnswerRequest, QuantityIsOneTo125) {
  EXPECT_EQ(Ask(Read(3, 0, 0)), (Pdu{0x83, 3}));
  EXPECT_EQ(Ask(Read(3, 0, 126)), (Pdu{0x83, 3}));
  EXPECT_EQ(Ask(Read(4, 0, 125)).size(), 252U);
}

TEST(AnswerRequest, ShortOrLongReadIsABadValue) {
  EXPECT_EQ(Ask({3}), (Pdu{0x83, 3}));
  EXPECT_EQ(Ask({3, 0, 0, 0}), (Pdu{0x83, 3}));
  EXPECT_EQ(Ask({4, 0, 0, 0, 1, 0}), (Pdu{0x84, 3}));
  EXPECT_EQ(Ask({2, 0}), (Pdu{0x82, 3}));
}

TEST(AnswerRequest, DiscreteInputsComeLowBitFirst) {
  const auto snapshot = test::HeldSnapshot(Reason::kFrameMissing);  // b1 held, b12 camera
  EXPECT_EQ(Ask(Read(2, 0, 16), snapshot), (Pdu{2, 2, 0x02, 0x10}));
  EXPECT_EQ(Ask(Read(2, 12, 1), snapshot), (Pdu{2, 1, 0x01}));
}

TEST(AnswerRequest, DiscreteInputsEndAt47) {
  EXPECT_EQ(Ask(Read(2, 0, 48)).size(), 8U);
  EXPECT_EQ(Ask(Read(2, 0, 49)), (Pdu{0x82, 2}));
  EXPECT_EQ(Ask(Read(2, 0, 0)), (Pdu{0x82, 3}));
  EXPECT_EQ(Ask(Read(2, 0, 2001)), (Pdu{0x82, 3}));
}

TEST(AnswerRequest, CoilsAreTheDiscreteInputsAndThreeMore) {
  auto snapshot = test::HeldSnapshot(Reason::kFrameMissing);
  snapshot.maintenance = true;
  EXPECT_EQ(Ask(Read(1, 0, 16), snapshot), (Pdu{1, 2, 0x22, 0x10}));
  EXPECT_EQ(Ask(Read(1, 48, 3), snapshot), (Pdu{1, 1, 0b100}));
  EXPECT_EQ(Ask(Read(1, 0, 51)).size(), 9U);
  EXPECT_EQ(Ask(Read(1, 0, 52)), (Pdu{0x81, 2}));
  EXPECT_EQ(Ask(Read(1, 0, 0)), (Pdu{0x81, 3}));
}

TEST(AnswerRequest, BitsFollowTheSnapshotInEveryByteOrder) {
  auto snapshot = test::GoodSnapshot();
  snapshot.good->abnormal = true;
  const auto plain = Ask(Read(2, 0, 48), snapshot);
  snapshot.format.byte_order = ByteOrder::kDcba;
  EXPECT_EQ(Ask(Read(2, 0, 48), snapshot), plain);
}

TEST(AnswerRequest, OtherFunctionsAreNotServed) {
  for (const std::uint8_t function : {0, 7, 8, 11, 20, 21, 24, 100}) {
    EXPECT_EQ(Ask({function, 0, 0, 0, 1}), (Pdu{static_cast<std::uint8_t>(function | 0x80), 1})) << int{function};
  }
}

TEST(AnswerRequest, ServerIdNamesProgramSiteAndBin) {
  const auto reply = Ask({17});
  ASSERT_GT(reply.size(), 4U);
  EXPECT_EQ(reply[1], reply.size() - 2);
  EXPECT_EQ(reply[2], 3);
  EXPECT_EQ(reply[3], 0xFF);
  EXPECT_EQ(std::string(reply.begin() + 4, reply.end()), "granaryd 0.1.0, depot-7, bay-3");
}

TEST(AnswerRequest, BasicIdentificationHasThreeObjects) {
  const auto reply = Ask({43, 14, 1, 0});
  EXPECT_EQ(Pdu(reply.begin(), reply.begin() + 9), (Pdu{43, 14, 1, 0x83, 0, 0, 3, 0, 15}));
  EXPECT_EQ(std::string(reply.begin() + 9, reply.begin() + 24), "Granary project");
}

TEST(AnswerRequest, ExtendedIdentificationEndsWithTheBin) {
  const auto reply = Ask({43, 14, 3, 0});
  EXPECT_EQ(reply[6], 6);
  EXPECT_EQ(std::string(reply.end() - 5, reply.end()), "bay-3");
}

TEST(AnswerRequest, SingleIdentityObjectIsGivenAlone) {
  EXPECT_EQ(Ask({43, 14, 4, 2}), (Pdu{43, 14, 4, 0x83, 0, 0, 1, 2, 5, '0', '.', '1', '.', '0'}));
}

TEST(AnswerRequest, UnknownIdentityObjectIsABadAddressAlone) { EXPECT_EQ(Ask({43, 14, 4, 3}), (Pdu{0xAB, 2})); }

TEST(AnswerRequest, UnknownIdentityObjectStartsAStreamAnew) { EXPECT_EQ(Ask({43, 14, 1, 0x77}), Ask({43, 14, 1, 0})); }

TEST(AnswerRequest, IdentityThatDoesNotFitOneReplyGoesOnInTheNext) {
  auto snapshot = test::GoodSnapshot();
  snapshot.bin.name = std::string(300, 'b');
  ModbusIdentity identity = test::kIdentity;
  identity.site = std::string(300, 's');
  const auto first = Ask({43, 14, 3, 0}, snapshot, identity);
  EXPECT_LE(first.size(), kMaxPduBytes);
  EXPECT_EQ(first[4], 0xFF);
  const auto second = Ask({43, 14, 3, first[5]}, snapshot, identity);
  EXPECT_EQ(second[4], 0);
  EXPECT_EQ(first[6] + second[6], 6);
}

TEST(AnswerRequest, IdentificationRefusesOtherCodes) {
  EXPECT_EQ(Ask({43, 14, 0, 0}), (Pdu{0xAB, 3}));
  EXPECT_EQ(Ask({43, 14, 5, 0}), (Pdu{0xAB, 3}));
  EXPECT_EQ(Ask({43, 14, 1}), (Pdu{0xAB, 3}));
  EXPECT_EQ(Ask({43, 13, 0, 0}), (Pdu{0xAB, 1}));
  EXPECT_EQ(Ask({43}), (Pdu{0xAB, 1}));
}

TEST(AnswerRequest, LongNamesDoNotBurstTheServerId) {
  auto snapshot = test::GoodSnapshot();
  snapshot.bin.name = std::string(1000, 'b');
  EXPECT_LE(Ask({17}, snapshot).size(), kMaxPduBytes);
}

}  // namespace
}  // namespace granary
