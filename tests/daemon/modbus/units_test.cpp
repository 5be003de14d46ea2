// What units answer to those who read, and that the image they answer from is never out of date.
#include "tests/daemon/modbus/units_fixture.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using test::ReadPdu;
using ModbusUnitsTest = test::UnitsTest;

TEST_F(ModbusUnitsTest, ReadsAreThoseOfTheEncodedSnapshot) {
  const auto image = test::Encode(snapshot_);
  for (int address = 0; address < kRegisterCount; address += 125) {
    const auto words = Read(address, 125);
    for (int i = 0; i < 125; ++i) {
      if (address + i >= 240 && address + i < 300) continue;  // counters
      ASSERT_EQ(words[i], image[address + i]) << address + i;
    }
  }
}

TEST_F(ModbusUnitsTest, PublicationIsSeenAtOnce) {
  ASSERT_EQ(ReadF32(10), 19.5F);
  snapshot_.good->volume_m3 = 21;
  units_.Publish(snapshot_);
  EXPECT_EQ(ReadF32(10), 21.0F);
}

TEST_F(ModbusUnitsTest, AgeGrowsWithTheClockAlone) {
  ASSERT_EQ(Read(8, 2), (test::Words{0, 90}));
  utc_ += 1s;
  EXPECT_EQ(Read(8, 2), (test::Words{0, 91}));
}

TEST_F(ModbusUnitsTest, AgeIsUnknownAsSoonAsTheClockIsSetBack) {
  ASSERT_EQ(Read(8, 2), (test::Words{0, 90}));
  utc_ = test::kMeasuredAt - 1h;
  EXPECT_EQ(Read(8, 2), (test::Words{0xFFFF, 0xFFFF}));
}

TEST_F(ModbusUnitsTest, CountersAreThoseOfTheMoment) {
  ASSERT_EQ(Read(242, 2), (test::Words{0, 0}));
  tally_.requests = 7;
  EXPECT_EQ(Read(242, 2), (test::Words{0, 7}));
  tally_.plc_pushes = 9;
  EXPECT_EQ(Read(200, 100).at(65), 9);
}

TEST_F(ModbusUnitsTest, CountersAreInTheChosenByteOrder) {
  snapshot_.format.byte_order = ByteOrder::kCdab;
  units_.Publish(snapshot_);
  tally_.requests = 7;
  EXPECT_EQ(Read(242, 2), (test::Words{7, 0}));
}

TEST_F(ModbusUnitsTest, CoilsFollowTheSnapshot) {
  EXPECT_EQ(Ask(ReadPdu(48, 3, 1)), (Pdu{1, 1, 0}));
  snapshot_.command = {BinCommand::kMeasure, CommandResult::kBusy};
  snapshot_.maintenance = true;
  units_.Publish(snapshot_);
  EXPECT_EQ(Ask(ReadPdu(48, 3, 1)), (Pdu{1, 1, 0b101}));
}

TEST_F(ModbusUnitsTest, UnitNoughtAnd255AreTheFirstBinAndOthersAreNone) {
  auto other = test::GoodSnapshot();
  other.bin.id = 5;
  units_.Publish(other);
  EXPECT_EQ(Ask(ReadPdu(346, 1), "a", 0), (Pdu{3, 2, 0, 3}));
  EXPECT_EQ(Ask(ReadPdu(346, 1), "a", 255), (Pdu{3, 2, 0, 3}));
  EXPECT_EQ(Ask(ReadPdu(346, 1), "a", 5), (Pdu{3, 2, 0, 5}));
  EXPECT_EQ(Ask(ReadPdu(346, 1), "a", 4), (Pdu{0x83, 0x0B}));
  EXPECT_EQ(Ask(test::WritePdu(910, 1), "a", 4), (Pdu{0x86, 0x0B}));
}

}  // namespace
}  // namespace granary
