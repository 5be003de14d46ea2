#include "daemon/ctl/modbus_reading.h"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "daemon/ctl/modbus_poll.h"
#include "daemon/ctl/modbus_watch.h"
#include "tests/daemon/modbus/snapshots.h"

namespace granary {
namespace {

using std::chrono::seconds;
using test::GoodSnapshot;
using test::HeldSnapshot;
using test::kIdentity;
using test::kMeasuredAt;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

/// What a client reads of `snapshot`, without a wire between.
Reading ReadingOf(const BinSnapshot& snapshot) {
  const RegisterImage image = EncodeRegisters({snapshot, kMeasuredAt + seconds(90), kIdentity, {}});
  Reading reading{snapshot.format, {}};
  for (const auto& row : RegisterTable()) {
    if (row.type == RegisterType::kMirror) continue;
    reading.rows.push_back({&row, Decode(row, std::span(image).subspan(row.address, row.words), reading.format)});
  }
  return reading;
}

TEST(Decode, EveryByteOrderGivesTheSameValues) {
  BinSnapshot snapshot = GoodSnapshot();
  const Reading abcd = ReadingOf(snapshot);
  for (const auto order : {ByteOrder::kCdab, ByteOrder::kDcba, ByteOrder::kBadc}) {
    snapshot.format.byte_order = order;
    const Reading other = ReadingOf(snapshot);
    for (std::size_t i = 0; i < abcd.rows.size(); ++i) {
      if (abcd.rows[i].row->name == "byte_order") continue;
      EXPECT_EQ(other.rows[i].value, abcd.rows[i].value) << abcd.rows[i].row->name;
    }
  }
}
TEST(Decode, FloatHasNoMoreDigitsThanWereSent) {
  EXPECT_EQ(TextOf(ReadingOf(GoodSnapshot()).Of("error_rate")), "1.4276");
}
TEST(Decode, TextEndsAtItsPadding) {
  EXPECT_EQ(std::get<std::string>(ReadingOf(GoodSnapshot()).Of("site")), "depot-7");
}
TEST(Decode, NotANumberIsUnknown) {
  EXPECT_EQ(ReadingOf(GoodSnapshot()).Of("rig_temperature"), ReadValue());  // not measured
}
TEST(Decode, LeastIntegerIsUnknown) {
  EXPECT_EQ(ReadingOf(GoodSnapshot()).Of("rig_temperature_i32"), ReadValue());
  EXPECT_EQ(ReadingOf(GoodSnapshot()).Of("volume_i32"), ReadValue(std::int64_t{19500}));
}
TEST(Decode, TimeOfAllOnesIsUnknown) {
  BinSnapshot snapshot = test::UnmeasuredSnapshot();
  EXPECT_EQ(ReadingOf(snapshot).Of("measured_at"), ReadValue());
  EXPECT_EQ(ReadingOf(snapshot).Of("next_in"), ReadValue());
}
TEST(Decode, CounterOfAllOnesIsANumber) {
  BinSnapshot snapshot = GoodSnapshot();
  snapshot.cycles = 0xFFFFFFFF;
  EXPECT_EQ(ReadingOf(snapshot).IntegerOf("cycles"), 0xFFFFFFFF);
}
TEST(Decode, MarkOfTheInvalidPolicyIsUnknown) {
  BinSnapshot snapshot = HeldSnapshot(Reason::kFrameMissing);
  snapshot.format.invalid = InvalidPolicy::kMinus9999;
  EXPECT_EQ(ReadingOf(snapshot).Of("volume"), ReadValue());
  EXPECT_EQ(ReadingOf(snapshot).Of("volume_i32"), ReadValue());
}
TEST(Decode, MarkIsANumberUnderAnotherPolicy) {
  BinSnapshot snapshot = GoodSnapshot();
  snapshot.rate_m3_h = -9999;
  EXPECT_EQ(ReadingOf(snapshot).Of("rate"), ReadValue(-9999.0));
}

TEST(BlocksNamed, AllIsEveryBlock) { EXPECT_EQ(BlocksNamed("all").size(), RegisterBlocks().size()); }
TEST(BlocksNamed, UnknownNameIsNone) { EXPECT_THAT(BlocksNamed("mirrors"), IsEmpty()); }
TEST(RegisterBlocks, HoldEveryRegisterButTheMirrors) {
  for (const auto& row : RegisterTable()) {
    if (row.type == RegisterType::kMirror) continue;
    const auto blocks = RegisterBlocks();
    EXPECT_TRUE(std::any_of(blocks.begin(), blocks.end(), [&](const auto& block) {
      return row.address >= block.first && row.address + row.words - 1 <= block.last;
    })) << row.name;
  }
}

TEST(Verdict, SpellsOutBitsClassAndReason) {
  const auto lines = Verdict(ReadingOf(HeldSnapshot(Reason::kFrameMissing)));
  EXPECT_THAT(lines[0], AllOf(HasSubstr("held"), HasSubstr("camera_fault")));
  EXPECT_THAT(lines[1], HasSubstr("4 failure"));
  EXPECT_THAT(lines[2], AllOf(HasSubstr("11 frame_missing"), HasSubstr("Check the trigger line")));
  EXPECT_THAT(lines[3], HasSubstr("none"));
}
TEST(Verdict, SaysThatTwoMeasurementsAreMixed) {
  Reading reading = ReadingOf(GoodSnapshot());
  for (auto& row : reading.rows) {
    if (row.row->name == "sequence_check") row.value = std::int64_t{16};
  }
  EXPECT_THAT(Verdict(reading).back(), HasSubstr("NOT ONE SNAPSHOT"));
}
TEST(Verdict, CodesThatItDoesNotKnowAreNumbers) {
  Reading reading = ReadingOf(GoodSnapshot());
  for (auto& row : reading.rows) {
    if (row.row->name == "reason" || row.row->name == "namur_class") row.value = std::int64_t{999};
  }
  EXPECT_THAT(Verdict(reading)[1], HasSubstr("999, which"));
  EXPECT_THAT(Verdict(reading)[2], HasSubstr("999, which"));
}
TEST(ReadingToJson, UnknownIsNull) {
  const Reading reading = ReadingOf(GoodSnapshot());
  const auto values = ReadingToJson(reading, reading).at("values");
  EXPECT_TRUE(values.at("rig_temperature").is_null());
  EXPECT_EQ(values.at("volume"), 19.5);
  EXPECT_EQ(values.at("sequence"), 17);
}
TEST(ValueTable, TimesAreShownAsDates) {
  const auto lines = ValueTable(ReadingOf(GoodSnapshot()));
  EXPECT_THAT(lines, testing::Contains(AllOf(HasSubstr("measured_at"), HasSubstr("2026-11-22T06:00:00Z"))));
}

TEST(ReadingLog, TellsAChangeOnce) {
  ReadingLog log;
  const std::chrono::steady_clock::time_point start{};
  BinSnapshot snapshot = GoodSnapshot();
  EXPECT_THAT(log.Lines(ReadingOf(snapshot), start), ElementsAre(HasSubstr("sequence 17  19.5 m3  1.4276 %  valid")));
  ++snapshot.heartbeat;
  EXPECT_THAT(log.Lines(ReadingOf(snapshot), start + seconds(1)), IsEmpty());
  snapshot.good->volume_m3 = 20;
  EXPECT_THAT(log.Lines(ReadingOf(snapshot), start + seconds(2)), ElementsAre(HasSubstr("20 m3")));
}
TEST(ReadingLog, TellsThatTheHeartbeatStandsStillAndGoesOn) {
  ReadingLog log;
  const std::chrono::steady_clock::time_point start{};
  BinSnapshot snapshot = GoodSnapshot();
  EXPECT_THAT(log.Lines(ReadingOf(snapshot), start), SizeIs(1));
  EXPECT_THAT(log.Lines(ReadingOf(snapshot), start + seconds(4)), IsEmpty());
  EXPECT_THAT(log.Lines(ReadingOf(snapshot), start + seconds(5)), ElementsAre(HasSubstr("stands still")));
  EXPECT_THAT(log.Lines(ReadingOf(snapshot), start + seconds(60)), IsEmpty());
  ++snapshot.heartbeat;
  EXPECT_THAT(log.Lines(ReadingOf(snapshot), start + seconds(61)), ElementsAre(HasSubstr("goes on")));
}
TEST(ReadingLog, TellsARestart) {
  ReadingLog log;
  BinSnapshot snapshot = GoodSnapshot();
  EXPECT_THAT(log.Lines(ReadingOf(snapshot), {}), SizeIs(1));
  ++snapshot.restarts;
  EXPECT_THAT(log.Lines(ReadingOf(snapshot), {}), ElementsAre(HasSubstr("started again")));
}

}  // namespace
}  // namespace granary
