#include "daemon/modbus/registers.h"

#include <bit>
#include <chrono>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>

#include <gtest/gtest.h>
#include <modbus/modbus.h>

#include "tests/daemon/modbus/snapshots.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using test::Encode;
using test::F32At;
using test::U32At;

const RegisterRow& RowAt(int address) {
  for (const auto& row : RegisterTable()) {
    if (row.address == address) return row;
  }
  throw std::out_of_range("no row at " + std::to_string(address));
}

std::string TextAt(const RegisterImage& image, int address, int words) {
  std::string text;
  for (int i = 0; i < words; ++i) {
    text += static_cast<char>(image[address + i] >> 8);
    text += static_cast<char>(image[address + i]);
  }
  return text.substr(0, text.find('\0'));
}

TEST(RegisterTable, RowsDoNotOverlapAndLieInsideTheMap) {
  int next_free = 0;
  for (const auto& row : RegisterTable()) {
    EXPECT_GE(row.address, next_free) << row.name;
    next_free = row.address + row.words;
  }
  EXPECT_LE(next_free, kRegisterCount);
}

TEST(RegisterTable, WordsFitTheType) {
  for (const auto& row : RegisterTable()) {
    if (row.type == RegisterType::kAscii) continue;  // as long as it likes
    const int words = row.type == RegisterType::kU16 ? 1 : row.type == RegisterType::kMirror ? kMirroredRegisters : 2;
    EXPECT_EQ(row.words, words) << row.name;
  }
}

TEST(RegisterTable, NamesAreUnique) {
  std::set<std::string_view> names;
  for (const auto& row : RegisterTable()) EXPECT_TRUE(names.insert(row.name).second) << row.name;
}

TEST(RegisterTable, SummaryTakesEveryAddressUpTo64) {
  int next_free = 0;
  for (const auto& row : RegisterTable()) {
    if (row.address > 64) break;
    EXPECT_EQ(row.address, next_free) << row.name;
    next_free = row.address + row.words;
  }
  EXPECT_EQ(next_free, 65);
}

TEST(RegisterTable, SummaryHasTheTypesOfTheContract) {
  for (const int address : {0, 1, 2, 3, 4, 5, 56, 57, 60, 61, 64}) EXPECT_EQ(RowAt(address).type, RegisterType::kU16);
  for (const int address : {6, 8, 52, 54, 58}) EXPECT_EQ(RowAt(address).type, RegisterType::kU32);
  for (int address = 10; address <= 50; address += 2) EXPECT_EQ(RowAt(address).type, RegisterType::kF32);
  EXPECT_EQ(RowAt(62).type, RegisterType::kF32);
}

TEST(EncodeRegisters, FloatsAreHighWordFirst) {
  auto snapshot = test::GoodSnapshot();
  snapshot.good->volume_m3 = 123456.0;  // 0x47F12000
  const auto image = Encode(snapshot);
  EXPECT_EQ(image[10], 0x47F1);
  EXPECT_EQ(image[11], 0x2000);
}

// libmodbus' own float helpers disagree between releases (3.1.6 sets and gets ABCD differently); its 32-bit macro does
// not, and is what a client builds the word from.
TEST(EncodeRegisters, LibmodbusReadsTheVolumeBack) {
  const auto image = Encode(test::GoodSnapshot());
  const auto word = static_cast<std::uint32_t>(MODBUS_GET_INT32_FROM_INT16(image.data(), 10));
  EXPECT_EQ(std::bit_cast<float>(word), 19.5F);
}

TEST(EncodeRegisters, EveryFigureIsInItsPlace) {
  const auto image = Encode(test::GoodSnapshot());
  EXPECT_EQ(F32At(image, 12), 39.0F);
  EXPECT_EQ(F32At(image, 14), 1.5F);
  EXPECT_EQ(F32At(image, 16), 0.75F);
  EXPECT_EQ(F32At(image, 18), 2.25F);
  EXPECT_EQ(F32At(image, 20), 3.5F);
  EXPECT_EQ(F32At(image, 22), 2.75F);
  EXPECT_EQ(F32At(image, 24), 4.25F);
  EXPECT_EQ(F32At(image, 26), 30.5F);
  EXPECT_EQ(F32At(image, 28), 790.0F);
  EXPECT_EQ(F32At(image, 36), 1.4276F);
  EXPECT_EQ(F32At(image, 38), 0.5F);
  EXPECT_EQ(F32At(image, 42), 97.5F);
  EXPECT_EQ(F32At(image, 44), 0.25F);
  EXPECT_EQ(F32At(image, 48), 0.125F);
  EXPECT_EQ(F32At(image, 62), 0.05F);
}

TEST(EncodeRegisters, MassesAreInTonnes) {
  const auto image = Encode(test::GoodSnapshot());
  EXPECT_EQ(F32At(image, 30), 15.405F);
  EXPECT_EQ(F32At(image, 32), 0.012F);
  EXPECT_EQ(F32At(image, 34), 15.2F);
}

TEST(EncodeRegisters, RateIsThatOfTheSnapshot) {
  auto snapshot = test::GoodSnapshot();
  snapshot.rate_m3_h = -2.5;
  EXPECT_EQ(F32At(Encode(snapshot), 40), -2.5F);
}

TEST(EncodeRegisters, UnknownFigureIsNaN) {
  auto snapshot = test::GoodSnapshot();
  snapshot.good->temperature_c.reset();
  snapshot.good->error_rate_percent.reset();
  const auto image = Encode(snapshot);
  EXPECT_TRUE(std::isnan(F32At(image, 50)));
  EXPECT_TRUE(std::isnan(F32At(image, 36)));
  EXPECT_TRUE(std::isnan(F32At(image, 40)));  // no rate before the second measurement
  EXPECT_TRUE(std::isnan(F32At(image, 46)));  // repeatability needs repeats
}

TEST(EncodeRegisters, WithoutAMeasurementEveryFloatOfItIsAQuietNaN) {
  const auto image = Encode(test::UnmeasuredSnapshot());
  for (const auto& row : RegisterTable()) {
    if (row.type != RegisterType::kF32 || !row.figure) continue;
    EXPECT_TRUE(std::isnan(F32At(image, row.address))) << row.name;
    EXPECT_TRUE(image[row.address] & 0x0040) << row.name << ": a signalling NaN traps on some PLCs";
  }
}

TEST(EncodeRegisters, WithoutAMeasurementTimesAreUnknownAndNotZero) {
  const auto image = Encode(test::UnmeasuredSnapshot());
  EXPECT_EQ(U32At(image, 6), kUnknownU32);
  EXPECT_EQ(U32At(image, 8), kUnknownU32);
  EXPECT_EQ(image[61], kUnknownU16);
  EXPECT_EQ(image[3], 0);
}

TEST(EncodeRegisters, HeldFigureStaysWhileTheReasonIsThatOfTheLastCycle) {
  const auto image = Encode(test::HeldSnapshot(Reason::kCoverageLow));
  EXPECT_EQ(F32At(image, 10), 19.5F);
  EXPECT_EQ(image[5], 17);
  EXPECT_EQ(image[2], 40);
  EXPECT_EQ(image[56], 40);
}

TEST(EncodeRegisters, ReasonIsNotMeasuredBeforeTheFirstCycle) {
  EXPECT_EQ(Encode(test::UnmeasuredSnapshot())[2], 1);
  auto restored = test::GoodSnapshot();
  restored.last.reset();
  EXPECT_EQ(Encode(restored)[2], 1);
}

TEST(EncodeRegisters, SequenceIsThereTwiceAndWrapsAt16Bits) {
  auto snapshot = test::GoodSnapshot();
  snapshot.good->sequence = 65536 + 9;
  const auto image = Encode(snapshot);
  EXPECT_EQ(image[5], 9);
  EXPECT_EQ(image[64], 9);
}

TEST(EncodeRegisters, UtcAndAgeAreInSeconds) {
  const auto image = Encode(test::GoodSnapshot(), test::kMeasuredAt + 90s + 900ms);
  EXPECT_EQ(U32At(image, 6), 1795327200U);
  EXPECT_EQ(U32At(image, 8), 90U);
}

TEST(EncodeRegisters, AgeIsUnknownWhenTheClockWasSetBack) {
  EXPECT_EQ(U32At(Encode(test::GoodSnapshot(), test::kMeasuredAt - 1s), 8), kUnknownU32);
}

TEST(EncodeRegisters, NextMeasurementCountsDownAndStopsAtZero) {
  const auto snapshot = test::GoodSnapshot();
  EXPECT_EQ(Encode(snapshot, test::kMeasuredAt)[61], 1800);
  EXPECT_EQ(Encode(snapshot, test::kMeasuredAt + 2h)[61], 0);
}

TEST(EncodeRegisters, NextMeasurementSaturatesBelowTheMarkForNone) {
  auto snapshot = test::GoodSnapshot();
  snapshot.next_at = test::kMeasuredAt + 24h;
  EXPECT_EQ(Encode(snapshot, test::kMeasuredAt)[61], 65534);
}

TEST(EncodeRegisters, HeartbeatHashVersionAndCountersAreThere) {
  const auto image = Encode(test::GoodSnapshot());
  EXPECT_EQ(image[4], 41);
  EXPECT_EQ(U32At(image, 58), 0xDEADBEEF);
  EXPECT_EQ(image[60], kMapVersion);
  EXPECT_EQ(U32At(image, 200), 70000U);
  EXPECT_EQ(U32At(image, 202), 2U);
  EXPECT_EQ(U32At(image, 240), 2U);
  EXPECT_EQ(U32At(image, 242), 5U);
}

TEST(EncodeRegisters, AbnormalIsAlarmBitZero) {
  auto snapshot = test::GoodSnapshot();
  snapshot.good->abnormal = true;
  snapshot.abnormal_latched = true;
  const auto image = Encode(snapshot);
  EXPECT_EQ(U32At(image, 52), 1U);
  EXPECT_EQ(U32At(image, 54), 1U);
}

TEST(EncodeRegisters, IdentityIsTextHighByteFirst) {
  const auto image = Encode(test::GoodSnapshot());
  EXPECT_EQ(image[308], ('g' << 8) | 'r');
  EXPECT_EQ(TextAt(image, 300, 8), "Granary project");
  EXPECT_EQ(TextAt(image, 308, 8), "granaryd");
  EXPECT_EQ(TextAt(image, 316, 6), "0.1.0");
  EXPECT_EQ(TextAt(image, 322, 12), "depot-7");
  EXPECT_EQ(TextAt(image, 334, 12), "bay-3");
  EXPECT_EQ(image[346], 3);
}

TEST(EncodeRegisters, LongNameIsCutBetweenCharactersAndStaysInItsPlace) {
  auto snapshot = test::GoodSnapshot();
  snapshot.bin.name = "1234567890123456789012粮仓";  // the first of the two would end at byte 25, the field at 24
  const auto image = Encode(snapshot);
  EXPECT_EQ(TextAt(image, 334, 12), "1234567890123456789012");
  EXPECT_EQ(image[346], 3);
}

TEST(EncodeRegisters, ReservedReadsZero) {
  const auto image = Encode(test::GoodSnapshot());
  std::set<int> claimed;
  for (const auto& row : RegisterTable()) {
    for (int i = 0; i < row.words; ++i) claimed.insert(row.address + i);
  }
  for (int address = 0; address < kRegisterCount; ++address) {
    if (!claimed.contains(address)) {
      EXPECT_EQ(image[address], 0) << address;
    }
  }
}

TEST(CutText, KeepsWhatFits) { EXPECT_EQ(CutText("bay", 3), "bay"); }

TEST(CutText, NeverLeavesHalfACharacter) {
  EXPECT_EQ(CutText("a粮", 3), "a");
  EXPECT_EQ(CutText("a粮", 4), "a粮");
}

}  // namespace
}  // namespace granary
