// Byte orders, invalid policies, mirrors, scaled integers and the 5708 block.
#include <bit>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "daemon/modbus/registers.h"
#include "tests/daemon/modbus/snapshots.h"

namespace granary {
namespace {

using test::Encode;
using test::F32At;
using test::U32At;

BinSnapshot In(ByteOrder order, BinSnapshot snapshot = test::GoodSnapshot()) {
  snapshot.format.byte_order = order;
  return snapshot;
}

BinSnapshot Under(InvalidPolicy policy, BinSnapshot snapshot) {
  snapshot.format.invalid = policy;
  return snapshot;
}

std::int32_t I32At(const RegisterImage& image, int address) {
  return std::bit_cast<std::int32_t>(U32At(image, address));
}

bool IsFormatted(const RegisterRow& row) {
  return row.address < kFormattedRegisters && (row.type == RegisterType::kU32 || row.type == RegisterType::kF32);
}

std::uint16_t Swapped(std::uint16_t word) { return static_cast<std::uint16_t>((word << 8) | (word >> 8)); }

/// The two words of an ABCD value in another order.
std::pair<std::uint16_t, std::uint16_t> Ordered(std::uint16_t high, std::uint16_t low, ByteOrder order) {
  switch (order) {
    case ByteOrder::kAbcd:
      return {high, low};
    case ByteOrder::kCdab:
      return {low, high};
    case ByteOrder::kDcba:
      return {Swapped(low), Swapped(high)};
    case ByteOrder::kBadc:
      return {Swapped(high), Swapped(low)};
  }
  throw std::logic_error("order");
}

constexpr ByteOrder kOrders[] = {ByteOrder::kAbcd, ByteOrder::kCdab, ByteOrder::kDcba, ByteOrder::kBadc};

TEST(FindRegister, FindsByNameOrNot) {
  ASSERT_TRUE(FindRegister("volume"));
  EXPECT_EQ(FindRegister("volume")->address, 10);
  EXPECT_EQ(FindRegister("Volume"), nullptr);
  EXPECT_EQ(FindRegister(""), nullptr);
}

TEST(EncodeRow, WritesOneRowInTheOrderAskedFor) {
  const auto snapshot = test::GoodSnapshot();
  const RegisterSource source{snapshot, test::kMeasuredAt, test::kIdentity, {}};
  std::vector<std::uint16_t> words(2);
  EncodeRow(*FindRegister("configuration_hash"), source, {ByteOrder::kBadc, {}}, words);
  EXPECT_EQ(words, (std::vector<std::uint16_t>{0xADDE, 0xEFBE}));
  EncodeRow(*FindRegister("volume_i32"), source, {ByteOrder::kCdab, {}}, words);
  EXPECT_EQ(words, (std::vector<std::uint16_t>{19500, 0}));
}

TEST(EncodeRow, RefusesAnotherNumberOfWords) {
  const auto snapshot = test::GoodSnapshot();
  const RegisterSource source{snapshot, test::kMeasuredAt, test::kIdentity, {}};
  std::vector<std::uint16_t> words(3);
  EXPECT_THROW(EncodeRow(*FindRegister("volume"), source, {}, words), std::invalid_argument);
}

TEST(EncodeRow, OverwritesWhatTheWordsHeld) {
  const auto snapshot = test::GoodSnapshot();
  const RegisterSource source{snapshot, test::kMeasuredAt, test::kIdentity, {}};
  for (const auto& row : RegisterTable()) {
    std::vector<std::uint16_t> clean(row.words), dirty(row.words, 0xAAAA);
    EncodeRow(row, source, {}, clean);
    EncodeRow(row, source, {}, dirty);
    EXPECT_EQ(clean, dirty) << row.name;
  }
}

TEST(ByteOrder, MovesThe32BitValuesBelow900AndNothingElse) {
  const auto plain = Encode(test::GoodSnapshot());
  for (const ByteOrder order : kOrders) {
    RegisterImage expected = plain;
    for (const auto& row : RegisterTable()) {
      if (!IsFormatted(row)) continue;
      const auto [first, second] = Ordered(plain[row.address], plain[row.address + 1], order);
      expected[row.address] = first;
      expected[row.address + 1] = second;
    }
    expected[900] = static_cast<std::uint16_t>(order);
    EXPECT_EQ(Encode(In(order)), expected) << static_cast<int>(order);
  }
}

TEST(ByteOrder, VolumeInAllFour) {
  auto snapshot = test::GoodSnapshot();
  snapshot.good->volume_m3 = 123456.0;  // 0x47F12000
  const std::pair<int, int> expected[] = {{0x47F1, 0x2000}, {0x2000, 0x47F1}, {0x0020, 0xF147}, {0xF147, 0x0020}};
  for (const ByteOrder order : kOrders) {
    const auto image = Encode(In(order, snapshot));
    EXPECT_EQ((std::pair<int, int>{image[10], image[11]}), expected[static_cast<int>(order)]);
  }
}

TEST(Mirror, ShowsTheSummaryAndTheBlockInItsOwnOrderWhateverIsChosen) {
  const int addresses[] = {2000, 2200, 2400, 2600};
  for (const ByteOrder mirrored : kOrders) {
    const auto straight = Encode(In(mirrored));
    for (const ByteOrder chosen : kOrders) {
      const auto image = Encode(In(chosen));
      for (int i = 0; i < kMirroredRegisters; ++i) {
        ASSERT_EQ(image[addresses[static_cast<int>(mirrored)] + i], straight[i]) << i;
      }
    }
  }
}

TEST(InvalidPolicy, CurrentFiguresAreTheSameUnderAll) {
  const auto hold = Encode(test::GoodSnapshot()), nan = Encode(Under(InvalidPolicy::kNan, test::GoodSnapshot()));
  for (const auto& row : RegisterTable()) {
    if (row.address == 901) continue;
    for (int i = 0; i < row.words; ++i) EXPECT_EQ(nan[row.address + i], hold[row.address + i]) << row.name;
  }
}

TEST(InvalidPolicy, NanHidesEveryFigureThatIsNotCurrent) {
  auto stale = test::GoodSnapshot();
  stale.stale = true;
  for (const auto& snapshot : {test::HeldSnapshot(Reason::kTooDark), stale, test::UnmeasuredSnapshot()}) {
    const auto image = Encode(Under(InvalidPolicy::kNan, snapshot));
    for (const auto& row : RegisterTable()) {
      if (!row.figure) continue;
      if (row.type == RegisterType::kF32) {
        EXPECT_EQ(U32At(image, row.address), 0x7FC00000U) << row.name;
      } else {
        EXPECT_EQ(I32At(image, row.address), kUnknownI32) << row.name;
      }
    }
  }
}

TEST(InvalidPolicy, Minus9999IsShownInsteadOfWhatIsHeldOrUnknown) {
  for (const auto& snapshot : {test::HeldSnapshot(Reason::kTooDark), test::UnmeasuredSnapshot()}) {
    const auto image = Encode(Under(InvalidPolicy::kMinus9999, snapshot));
    for (const auto& row : RegisterTable()) {
      if (!row.figure) continue;
      if (row.type == RegisterType::kF32) {
        EXPECT_EQ(F32At(image, row.address), -9999.0F) << row.name;
      } else {
        EXPECT_EQ(I32At(image, row.address), -9999) << row.name;
      }
    }
  }
}

TEST(InvalidPolicy, Minus9999IsShownForTheOneFigureThatWasNotMeasured) {
  const auto image = Encode(Under(InvalidPolicy::kMinus9999, test::GoodSnapshot()));
  EXPECT_EQ(F32At(image, 10), 19.5F);
  EXPECT_EQ(F32At(image, 50), -9999.0F);  // no temperature
  EXPECT_EQ(I32At(image, 3040), -9999);
}

TEST(InvalidPolicy, TouchesNoTimeNoStatusNoDiagnosticsAndNoIdentity) {
  const auto held = test::HeldSnapshot(Reason::kTooDark);
  const auto hold = Encode(held), nan = Encode(Under(InvalidPolicy::kNan, held));
  for (const auto& row : RegisterTable()) {
    if (row.figure || row.type == RegisterType::kMirror || row.address == 901) continue;
    for (int i = 0; i < row.words; ++i) EXPECT_EQ(nan[row.address + i], hold[row.address + i]) << row.name;
  }
}

TEST(InvalidPolicy, MirrorsObeyIt) {
  const auto image = Encode(Under(InvalidPolicy::kMinus9999, test::HeldSnapshot(Reason::kTooDark)));
  EXPECT_EQ(F32At(image, 2010), -9999.0F);
}

TEST(InvalidPolicy, InjectedFigureIsCurrent) {
  auto snapshot = Under(InvalidPolicy::kNan, test::GoodSnapshot());
  snapshot.injected = true;
  const auto image = Encode(snapshot);
  EXPECT_EQ(F32At(image, 10), 19.5F);
  EXPECT_EQ(image[0], (1 << 0) | (1 << 4));
}

TEST(ScaledIntegers, AreAThousandTimesTheSummaryInItsOrder) {
  auto snapshot = test::GoodSnapshot();
  snapshot.good->temperature_c = -12.5;
  snapshot.good->repeatability_rsd_percent = 0.25;
  snapshot.rate_m3_h = -2.5;
  const auto image = Encode(snapshot);
  int integer = 3000;
  for (const auto& row : RegisterTable()) {
    if (row.address > 62 || row.type != RegisterType::kF32) continue;
    EXPECT_NEAR(I32At(image, integer), 1000.0 * double{F32At(image, row.address)}, 0.51) << row.name;
    EXPECT_EQ(FindRegister(std::string(row.name) + "_i32")->address, integer);
    integer += 2;
  }
  EXPECT_EQ(integer, 3044);
  EXPECT_EQ(I32At(image, 3000), 19500);
  EXPECT_EQ(I32At(image, 3040), -12500);
}

TEST(ScaledIntegers, UnknownIsTheLeastNumber) { EXPECT_EQ(I32At(Encode(test::GoodSnapshot()), 3040), kUnknownI32); }

TEST(ScaledIntegers, OutOfRangeIsUnknownAndNeverWrapped) {
  auto snapshot = test::GoodSnapshot();
  snapshot.good->volume_m3 = 2147483.6;
  EXPECT_EQ(I32At(Encode(snapshot), 3000), 2147483600);
  for (const double volume : {2147483.648, -2147483.648, -2147483.649, 1e300, -1e300}) {
    snapshot.good->volume_m3 = volume;
    EXPECT_EQ(I32At(Encode(snapshot), 3000), kUnknownI32) << volume;
  }
}

TEST(ScaledIntegers, AreHighWordFirstInEveryByteOrder) {
  const auto image = Encode(In(ByteOrder::kDcba));
  EXPECT_EQ(I32At(image, 3000), 19500);
}

// Source: table B-1 of the Rosemount 5708 reference manual, 00809-0100-4570 Rev DA.
TEST(Block5708, HasTheThirteenValuesInTheirOrderAndUnits) {
  auto snapshot = test::GoodSnapshot();
  snapshot.good->temperature_c = 25;
  ModbusIdentity identity = test::kIdentity;
  identity.serial = 16777215;
  const auto image = EncodeRegisters({snapshot, test::kMeasuredAt, identity, {}});
  const float expected[] = {3.5F,  2.75F, 4.25F, 39000.0F, 10.24F,      57.841F, 25.0F,
                            77.0F, 1.5F,  0.79F, 15.405F,  16777215.0F, 3.0F};
  int address = 100;
  for (const float value : expected) {
    EXPECT_NEAR(F32At(image, address), value, 1e-3F) << address;  // the SNR is written here with three decimals
    address += 2;
  }
  EXPECT_EQ(address, kMirroredRegisters);
}

TEST(Block5708, SnrOfAnEmptyBinOrOfNoUncertaintyIsUnknown) {
  auto empty = test::GoodSnapshot();
  empty.good->volume_m3 = 0;
  EXPECT_TRUE(std::isnan(F32At(Encode(empty), 110)));
  auto certain = test::GoodSnapshot();
  certain.good->volume_u95_m3 = 0;
  EXPECT_TRUE(std::isnan(F32At(Encode(certain), 110)));
}

TEST(Diagnostics, CountersHaveTheirPlaces) {
  auto snapshot = test::GoodSnapshot();
  snapshot.restarts = 4;
  const ModbusCounters counters{.writes = 1,
                                .writes_refused = 2,
                                .rtu_requests = 3,
                                .rtu_others = 4,
                                .rtu_errors = 5,
                                .plc_connected = 6,
                                .plc_pushes = 7,
                                .plc_failures = 8,
                                .plc_pushed_at = 9};
  const auto image = EncodeRegisters({snapshot, test::kMeasuredAt, test::kIdentity, counters});
  for (int i = 0; i < 9; ++i) EXPECT_EQ(U32At(image, 252 + 2 * i), static_cast<std::uint32_t>(i + 1));
  EXPECT_EQ(U32At(image, 234), 4U);
}

TEST(Diagnostics, TimeOfNoPushIsUnknown) { EXPECT_EQ(U32At(Encode(test::GoodSnapshot()), 268), kUnknownU32); }

TEST(Controls, ShowFormatHandshakeAndBookInForce) {
  auto snapshot = test::GoodSnapshot();
  snapshot.format = {ByteOrder::kBadc, InvalidPolicy::kMinus9999};
  snapshot.command = {BinCommand::kInhibit, CommandResult::kRejected};
  snapshot.book.in_force =
      WithBook({}, {.book_mass_kg = 15200, .density_kg_m3 = 790, .correction = 1.25, .loss_kg = 12});
  snapshot.book.commit = CommandResult::kDone;
  const auto image = Encode(snapshot);
  EXPECT_EQ(image[900], 3);
  EXPECT_EQ(image[901], 2);
  EXPECT_EQ(image[910], 3);
  EXPECT_EQ(image[911], 3);
  EXPECT_EQ(image[912], 3);
  EXPECT_EQ(F32At(image, 920), 15.2F);
  EXPECT_EQ(F32At(image, 922), 790.0F);
  EXPECT_EQ(F32At(image, 924), 1.25F);
  EXPECT_EQ(F32At(image, 926), 0.012F);
  EXPECT_EQ(image[930], 2);
}

TEST(Controls, UnknownBookAndDensityAreNaN) {
  auto snapshot = test::GoodSnapshot();
  snapshot.format.invalid = InvalidPolicy::kMinus9999;  // is not about these
  const auto image = Encode(snapshot);
  EXPECT_TRUE(std::isnan(F32At(image, 920)));
  EXPECT_TRUE(std::isnan(F32At(image, 922)));
}

}  // namespace
}  // namespace granary
