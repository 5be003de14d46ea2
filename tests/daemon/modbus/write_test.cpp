#include "daemon/modbus/write.h"

#include <bit>
#include <cmath>
#include <cstdint>
#include <initializer_list>

#include <gtest/gtest.h>

#include "tests/daemon/modbus/snapshots.h"

namespace granary {
namespace {

using Bytes = Pdu;

BinSnapshot Writable() {
  auto snapshot = test::GoodSnapshot();
  snapshot.book.writable = true;
  return snapshot;
}

WritePlan Plan(const Bytes& request, const BinSnapshot& snapshot = Writable()) {
  return PlanWrite(request, snapshot, test::Encode(snapshot));
}

Bytes WriteOne(std::uint8_t function, int address, int value) {
  return {function, static_cast<std::uint8_t>(address >> 8), static_cast<std::uint8_t>(address),
          static_cast<std::uint8_t>(value >> 8), static_cast<std::uint8_t>(value)};
}

Bytes WriteMany(int address, std::initializer_list<int> words) {
  Bytes request = WriteOne(16, address, static_cast<int>(words.size()));
  request.push_back(static_cast<std::uint8_t>(2 * words.size()));
  for (const int word : words) {
    request.push_back(static_cast<std::uint8_t>(word >> 8));
    request.push_back(static_cast<std::uint8_t>(word));
  }
  return request;
}

bool Is(const WritePlan& plan, ModbusException code) { return plan == WritePlan(code); }
bool Is(const WritePlan& plan, BinCommand command) { return plan == WritePlan(command); }
bool IsFormat(const WritePlan& plan, ByteOrder order, InvalidPolicy policy) {
  return plan == WritePlan(RegisterFormat{order, policy});
}

constexpr auto kBadAddress = ModbusException::kIllegalAddress;
constexpr auto kBadValue = ModbusException::kIllegalValue;

TEST(IsWrite, AreTheSixThatWrite) {
  int count = 0;
  for (int function = 0; function < 256; ++function) count += IsWrite(static_cast<std::uint8_t>(function));
  EXPECT_EQ(count, 6);
  for (const std::uint8_t function : {5, 6, 15, 16, 22, 23}) EXPECT_TRUE(IsWrite(function)) << int{function};
}

TEST(PlanWrite, FormatRegistersTakeTheirValuesOnly) {
  EXPECT_TRUE(IsFormat(Plan(WriteOne(6, 900, 3)), ByteOrder::kBadc, InvalidPolicy::kHold));
  EXPECT_TRUE(IsFormat(Plan(WriteOne(6, 901, 2)), ByteOrder::kAbcd, InvalidPolicy::kMinus9999));
  EXPECT_TRUE(Is(Plan(WriteOne(6, 900, 4)), kBadValue));
  EXPECT_TRUE(Is(Plan(WriteOne(6, 901, 3)), kBadValue));
}

TEST(PlanWrite, OneFormatRegisterKeepsTheOther) {
  auto snapshot = Writable();
  snapshot.format = {ByteOrder::kCdab, InvalidPolicy::kNan};
  EXPECT_TRUE(IsFormat(Plan(WriteOne(6, 900, 2), snapshot), ByteOrder::kDcba, InvalidPolicy::kNan));
  EXPECT_TRUE(IsFormat(Plan(WriteOne(6, 901, 0), snapshot), ByteOrder::kCdab, InvalidPolicy::kHold));
}

TEST(PlanWrite, BothFormatRegistersGoTogetherOrNotAtAll) {
  EXPECT_TRUE(IsFormat(Plan(WriteMany(900, {1, 1})), ByteOrder::kCdab, InvalidPolicy::kNan));
  EXPECT_TRUE(Is(Plan(WriteMany(900, {1, 9})), kBadValue));
  EXPECT_TRUE(Is(Plan(WriteMany(901, {1, 0})), kBadAddress));
}

TEST(PlanWrite, CommandIsNoughtToFour) {
  for (int command = 0; command <= 4; ++command) {
    EXPECT_TRUE(Is(Plan(WriteOne(6, 910, command)), static_cast<BinCommand>(command))) << command;
  }
  EXPECT_TRUE(Is(Plan(WriteOne(6, 910, 5)), kBadValue));
  EXPECT_TRUE(Is(Plan(WriteMany(910, {2})), BinCommand::kAcknowledge));
}

TEST(PlanWrite, EchoAndResultAreReadOnly) {
  EXPECT_TRUE(Is(Plan(WriteOne(6, 911, 1)), kBadAddress));
  EXPECT_TRUE(Is(Plan(WriteOne(6, 912, 1)), kBadAddress));
  EXPECT_TRUE(Is(Plan(WriteMany(910, {1, 1})), kBadAddress));
}

TEST(PlanWrite, RowsThatReadOnlyAreBadAddressesAndOthersAreNot) {
  const auto snapshot = Writable();
  const auto image = test::Encode(snapshot);
  for (const auto& row : RegisterTable()) {
    for (int i = 0; i < row.words; ++i) {
      const bool writable = row.access == RegisterAccess::kReadWrite;
      EXPECT_EQ(Is(PlanWrite(WriteOne(6, row.address + i, 1), snapshot, image), kBadAddress), !writable)
          << row.name << " + " << i;
    }
  }
}

TEST(PlanWrite, AddressesOutsideTheMapAreBad) {
  for (const int address : {65, 899, 902, 909, 913, 919, 931, 3999, 4000, 65535}) {
    EXPECT_TRUE(Is(Plan(WriteOne(6, address, 1)), kBadAddress)) << address;
  }
  EXPECT_TRUE(Is(Plan({22, 0xFF, 0xFF, 0, 0, 0, 1}), kBadAddress));
}

TEST(PlanWrite, BookRegistersAreCollected) {
  const auto plan = Plan(WriteMany(922, {0x4445, 0x8000}));
  const auto* book = std::get_if<BookWrite>(&plan);
  ASSERT_TRUE(book);
  EXPECT_FALSE(book->commit);
  EXPECT_FALSE(book->words[0]);
  EXPECT_EQ(book->words[2], 0x4445);
  EXPECT_EQ(book->words[3], 0x8000);
  EXPECT_FALSE(book->words[4]);
}

TEST(PlanWrite, CommitIsOneAndReservedIsNought) {
  EXPECT_TRUE(Is(Plan(WriteOne(6, 930, 0)), kBadValue));
  EXPECT_TRUE(Is(Plan(WriteOne(6, 930, 2)), kBadValue));
  EXPECT_TRUE(Is(Plan(WriteMany(927, {0, 1, 0, 1})), kBadValue));
  const auto plan = Plan(WriteMany(920, {1, 2, 3, 4, 5, 6, 7, 8, 0, 0, 1}));
  const auto* book = std::get_if<BookWrite>(&plan);
  ASSERT_TRUE(book);
  EXPECT_TRUE(book->commit);
  EXPECT_EQ(book->words[7], 8);
}

TEST(PlanWrite, BookOfTheConfigurationCannotBeWritten) {
  const auto snapshot = test::GoodSnapshot();
  EXPECT_TRUE(Is(Plan(WriteOne(6, 920, 1), snapshot), kBadAddress));
  EXPECT_TRUE(Is(Plan(WriteOne(6, 930, 1), snapshot), kBadAddress));
}

TEST(PlanWrite, GroupsCannotBeBridged) {
  EXPECT_TRUE(Is(Plan(WriteMany(901, {0, 0, 0, 0, 0, 0, 0, 0, 0, 1})), kBadAddress));
  EXPECT_TRUE(Is(Plan(WriteMany(929, {0, 1, 0})), kBadAddress));
}

TEST(PlanWrite, MaskIsAppliedToWhatTheRegisterReads) {
  auto snapshot = Writable();
  snapshot.format.byte_order = ByteOrder::kDcba;
  // (2 & 0xFFFC) | (1 & ~0xFFFC) is 1; with an AND mask of all ones the OR mask has no bit to set.
  EXPECT_TRUE(
      IsFormat(Plan({22, 0x03, 0x84, 0xFF, 0xFC, 0x00, 0x01}, snapshot), ByteOrder::kCdab, InvalidPolicy::kHold));
  EXPECT_TRUE(
      IsFormat(Plan({22, 0x03, 0x84, 0xFF, 0xFF, 0x00, 0x01}, snapshot), ByteOrder::kDcba, InvalidPolicy::kHold));
}

TEST(PlanWrite, LengthsThatDoNotAgreeAreBadValues) {
  for (const Bytes& request : {Bytes{6},
                               Bytes{6, 3, 132, 0},
                               Bytes{6, 3, 132, 0, 1, 0},
                               Bytes{5, 0, 48},
                               Bytes{5, 0, 48, 255, 0, 0},
                               Bytes{16, 3, 132, 0, 1},
                               Bytes{16, 3, 132, 0, 1, 2},
                               Bytes{16, 3, 132, 0, 1, 2, 0},
                               Bytes{16, 3, 132, 0, 1, 1, 0},
                               Bytes{16, 3, 132, 0, 2, 2, 0, 1},
                               Bytes{16, 3, 132, 0, 1, 2, 0, 1, 0},
                               Bytes{16, 3, 132, 0, 0, 0},
                               Bytes{15, 0, 48, 0, 1, 1},
                               Bytes{15, 0, 48, 0, 1, 2, 1, 0},
                               Bytes{15, 0, 48, 0, 0, 0},
                               Bytes{22, 3, 132, 0, 0, 0},
                               Bytes{22, 3, 132, 0, 0, 0, 1, 0},
                               Bytes{23},
                               Bytes{23, 0, 0, 0, 1, 3, 132, 0, 1, 2},
                               Bytes{23, 0, 0, 0, 1, 3, 132, 0, 1, 2, 0}}) {
    EXPECT_TRUE(Is(Plan(request), kBadValue)) << int{request[0]} << ", " << request.size() << " bytes";
  }
}

TEST(PlanWrite, QuantityHasTheStandardsLimits) {
  const auto many = [](std::uint8_t function, std::size_t head, int count) {
    Bytes request = function == 23 ? Bytes{23, 0, 0, 0, 1} : Bytes{};
    const Bytes tail = WriteOne(function, 900, count);
    request.insert(request.end(), tail.begin() + (function == 23 ? 1 : 0), tail.end());
    request.push_back(static_cast<std::uint8_t>(2 * count));
    request.resize(head + 2 * static_cast<std::size_t>(count));
    return request;
  };
  EXPECT_TRUE(Is(Plan(many(16, 6, 123)), kBadAddress));  // 900–1022: right in form, but not there
  EXPECT_TRUE(Is(Plan(many(16, 6, 124)), kBadValue));
  EXPECT_TRUE(Is(Plan(many(23, 10, 121)), kBadAddress));
  EXPECT_TRUE(Is(Plan(many(23, 10, 122)), kBadValue));
}

TEST(PlanWrite, CoilIsOnOrOff) {
  EXPECT_TRUE(Is(Plan(WriteOne(5, 48, 0xFF00)), BinCommand::kMeasure));
  EXPECT_TRUE(Is(Plan(WriteOne(5, 49, 0xFF00)), BinCommand::kAcknowledge));
  EXPECT_TRUE(Is(Plan(WriteOne(5, 50, 0xFF00)), BinCommand::kInhibit));
  EXPECT_TRUE(Is(Plan(WriteOne(5, 50, 0)), BinCommand::kRelease));
  EXPECT_TRUE(Is(Plan(WriteOne(5, 48, 1)), kBadValue));
}

TEST(PlanWrite, SwitchingAMomentaryCoilOffDoesNothing) {
  EXPECT_TRUE(std::holds_alternative<std::monostate>(Plan(WriteOne(5, 48, 0))));
  EXPECT_TRUE(std::holds_alternative<std::monostate>(Plan(WriteOne(5, 49, 0))));
}

TEST(PlanWrite, CoilsBelow48CannotBeWrittenNorThoseFrom51) {
  EXPECT_TRUE(Is(Plan(WriteOne(5, 47, 0xFF00)), kBadAddress));
  EXPECT_TRUE(Is(Plan(WriteOne(5, 51, 0xFF00)), kBadAddress));
  EXPECT_TRUE(Is(Plan({15, 0, 47, 0, 2, 1, 0b10}), kBadAddress));
  EXPECT_TRUE(Is(Plan({15, 0, 50, 0, 2, 1, 0b01}), kBadAddress));
}

TEST(PlanWrite, CoilsWrittenTogetherAreOneCommand) {
  EXPECT_TRUE(Is(Plan({15, 0, 48, 0, 3, 1, 0b001}), BinCommand::kMeasure));
  EXPECT_TRUE(Is(Plan({15, 0, 48, 0, 3, 1, 0b100}), BinCommand::kInhibit));
  EXPECT_TRUE(Is(Plan({15, 0, 48, 0, 3, 1, 0b011}), kBadValue));
  auto inhibited = Writable();
  inhibited.maintenance = true;
  EXPECT_TRUE(Is(Plan({15, 0, 48, 0, 3, 1, 0b110}, inhibited), BinCommand::kAcknowledge));
  EXPECT_TRUE(Is(Plan({15, 0, 48, 0, 3, 1, 0b000}, inhibited), BinCommand::kRelease));
}

TEST(BookOf, WrittenFiguresComeInKilogramsAndOthersStay) {
  const Inventory in_force =
      WithBook({}, {.book_mass_kg = 15200, .density_kg_m3 = 790, .correction = 1.01, .loss_kg = 12});
  BookWords words;
  words[0] = 0x4180;  // 16.0
  words[1] = 0;
  const BookData book = BookOf(words, in_force);
  EXPECT_EQ(book, (BookData{.book_mass_kg = 16000, .density_kg_m3 = 790, .correction = 1.01, .loss_kg = 12}));
}

TEST(BookOf, UnknownOrHalfWrittenIsNaN) {
  BookWords words;
  words[4] = 0x3F80;
  const BookData book = BookOf(words, {});
  EXPECT_TRUE(std::isnan(book.book_mass_kg));
  EXPECT_TRUE(std::isnan(book.density_kg_m3));
  EXPECT_TRUE(std::isnan(book.correction));
  EXPECT_EQ(book.loss_kg, 0);
}

TEST(HostOf, IsTheNameWithoutItsPort) {
  EXPECT_EQ(HostOf("192.168.7.20:40112"), "192.168.7.20");
  EXPECT_EQ(HostOf("[fe80::1]:40112"), "[fe80::1]");
  EXPECT_EQ(HostOf("[fe80::1]"), "[fe80::1]");
  EXPECT_EQ(HostOf("/dev/ttyS1"), "/dev/ttyS1");
  EXPECT_EQ(HostOf("/dev/serial/by-path/pci-0000:00:14.0-usb-0:1"), "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1");
}

}  // namespace
}  // namespace granary
