// What a PLC that works gets, and what is taken from it.
#include "daemon/modbus/plc_client.h"

#include <array>
#include <bit>
#include <chrono>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <modbus/modbus.h>
#include <poll.h>

#include "tests/daemon/modbus/plc_served.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using test::Eventually;
using test::FakePlc;
using test::PlcClientTest;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

TEST_F(PlcClientTest, BlocksLieOneStrideApart) {
  FakePlc plc;
  Start(plc.Port());
  client_->Publish(Snapshot(3, 17));
  ASSERT_TRUE(plc.AwaitWrites(1));
  client_->Publish(Snapshot(5, 4));
  ASSERT_TRUE(plc.AwaitWrites(2));
  const auto writes = plc.Writes();
  EXPECT_EQ(writes[0].address, 100);
  EXPECT_THAT(writes[0].words, ElementsAre(17, 0x419C, 0x0000, 1));  // 19.5 m³
  EXPECT_EQ(writes[1].address, 110);
  EXPECT_THAT(writes[1].words, ElementsAre(4, 0x419C, 0x0000, 1));
}

TEST_F(PlcClientTest, TallyCountsWhatIsTaken) {
  FakePlc plc;
  Start(plc.Port());
  client_->Publish(Snapshot(3, 17));
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_pushed_at != 0; }));
  const auto counters = tally_.Read();
  EXPECT_EQ(counters.plc_connected, 1U);
  EXPECT_EQ(counters.plc_pushes, 1U);
  EXPECT_EQ(counters.plc_failures, 0U);
  EXPECT_EQ(counters.plc_pushed_at, 1795327290U);
}

TEST_F(PlcClientTest, EndOfTheClientEndsTheConnectionInTheTally) {
  FakePlc plc;
  Start(plc.Port());
  client_->Publish(Snapshot(3, 17));
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_connected == 1; }));
  client_.reset();
  EXPECT_EQ(tally_.Read().plc_connected, 0U);
}

TEST_F(PlcClientTest, NothingGoesOutBeforeTheFirstSnapshot) {
  FakePlc plc;
  Start(plc.Port());
  client_.reset();
  EXPECT_EQ(plc.Connections(), 0);
}

TEST_F(PlcClientTest, OnlyNewsIsPushed) {
  FakePlc plc;
  Start(plc.Port());
  client_->Publish(Snapshot(3, 17));
  ASSERT_TRUE(plc.AwaitWrites(1));
  for (std::uint16_t beat = 0; beat < 50; ++beat) {
    BinSnapshot same = Snapshot(3, 17);
    same.heartbeat = beat;
    client_->Publish(same);
  }
  client_->Publish(Snapshot(3, 18));
  ASSERT_TRUE(plc.AwaitWrites(2));
  EXPECT_EQ(plc.Writes()[1].words[0], 18);
}

TEST_F(PlcClientTest, StatusBitsAloneArePushed) {
  FakePlc plc;
  Start(plc.Port());
  client_->Publish(Snapshot(3, 17));
  ASSERT_TRUE(plc.AwaitWrites(1));
  BinSnapshot measuring = Snapshot(3, 17);
  measuring.measuring = true;
  client_->Publish(measuring);
  ASSERT_TRUE(plc.AwaitWrites(2));
  EXPECT_THAT(plc.Writes()[1].words, ElementsAre(17, 0x419C, 0x0000, 0b101));
}

TEST_F(PlcClientTest, HeartbeatPushesTheSameAgain) {
  options_.heartbeat = 10ms;
  FakePlc plc;
  Start(plc.Port());
  client_->Publish(Snapshot(3, 17));
  ASSERT_TRUE(plc.AwaitWrites(5));
  EXPECT_EQ(plc.Writes()[4].words, plc.Writes()[0].words);
}

TEST_F(PlcClientTest, LongBlockIsSealedBySequenceCheck) {
  options_.stride = 500;
  options_.fields.assign(70, "volume");
  options_.fields.insert(options_.fields.begin(), "sequence_check");
  options_.fields.emplace_back("sequence");
  FakePlc plc;
  Start(plc.Port());
  client_->Publish(Snapshot(3, 17));
  ASSERT_TRUE(plc.AwaitWrites(2));
  const auto writes = plc.Writes();
  EXPECT_EQ(writes[0].address, 223);
  EXPECT_EQ(writes[1].address, 100);
  EXPECT_THAT(writes[1].words, SizeIs(123));
  EXPECT_EQ(plc.At(100), plc.At(241));
}

TEST_F(PlcClientTest, BinWithoutABlockIsNotPushed) {
  FakePlc plc;
  Start(plc.Port());
  client_->Publish(Snapshot(7, 1));
  client_->Publish(Snapshot(3, 17));
  ASSERT_TRUE(plc.AwaitWrites(1));
  EXPECT_EQ(plc.Writes()[0].address, 100);
}

TEST_F(PlcClientTest, ConnectionClosedWhileIdleIsNoFailure) {
  FakePlc plc;
  plc.Behave(FakePlc::Manner::kClosesAfterAnswer);
  Start(plc.Port());
  for (std::uint64_t n = 1; n <= 3; ++n) {
    client_->Publish(Snapshot(3, n));
    ASSERT_TRUE(plc.AwaitWrites(n));
    ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_pushes == n; }));
    ASSERT_TRUE(plc.AwaitClosed(static_cast<int>(n)));
  }
  EXPECT_EQ(plc.Connections(), 3);
  EXPECT_EQ(tally_.Read().plc_failures, 0U);
}

TEST_F(PlcClientTest, ReadBackOfWhatWasWrittenIsWell) {
  options_.read_back = true;
  FakePlc plc;
  Start(plc.Port());
  client_->Publish(Snapshot(3, 17));
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_pushes == 1; }));
  EXPECT_EQ(plc.Reads(), 1);
  EXPECT_EQ(tally_.Read().plc_failures, 0U);
}

TEST_F(PlcClientTest, LibmodbusServerTakesTheSummary) {
  options_.fields.clear();
  options_.stride = 100;
  const FileDescriptor listener = ListenTcp("127.0.0.1", 0);
  const auto mapping = std::unique_ptr<modbus_mapping_t, decltype(&modbus_mapping_free)>(
      modbus_mapping_new(0, 0, 300, 0), &modbus_mapping_free);
  std::thread server([&] {
    pollfd ready{listener.Get(), POLLIN, 0};
    if (poll(&ready, 1, 20000) != 1) return;
    int listening = listener.Get();
    const auto plc = std::unique_ptr<modbus_t, decltype(&modbus_free)>(modbus_new_tcp(nullptr, 1502), &modbus_free);
    if (modbus_tcp_accept(plc.get(), &listening) < 0) return;
    std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> request{};
    const int length = modbus_receive(plc.get(), request.data());
    if (length > 0) modbus_reply(plc.get(), request.data(), length, mapping.get());
    modbus_close(plc.get());
  });
  Start(BoundPort(listener.Get()));
  client_->Publish(Snapshot(3, 17));
  EXPECT_TRUE(Eventually([&] { return tally_.Read().plc_pushes == 1; }));
  server.join();
  const std::uint16_t* block = mapping->tab_registers + 100;
  EXPECT_EQ(block[5], 17);
  EXPECT_EQ(std::bit_cast<float>(test::U32At(block + 10)), 19.5F);
  EXPECT_EQ(test::U32At(block + 8), kUnknownU32);  // this snapshot is from after "now"
  EXPECT_EQ(block[64], 17);
}

TEST_F(PlcClientTest, WrongOptionsThrowWithTheirKeys) {
  options_.fields = {"volum"};
  options_.book_base = 65535;
  try {
    Start(502);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("modbus.plc.fields: no register is called \"volum\""));
    EXPECT_THAT(error.what(), HasSubstr("modbus.plc.book_base: 2 bins take 8 registers"));
  }
}

TEST_F(PlcClientTest, AddressWithoutPortThrows) {
  options_.address = "plc";
  EXPECT_THROW(PlcClient(options_, {Bin{}}, test::kIdentity, control_, tally_), std::invalid_argument);
}

TEST_F(PlcClientTest, NoBinsThrow) {
  options_.address = "127.0.0.1:502";
  EXPECT_THROW(PlcClient(options_, {}, test::kIdentity, control_, tally_), std::invalid_argument);
}

/// The first bin's book data are at 400, the second's at 404; they are read all the time.
class PlcBookDataTest : public PlcClientTest {
 protected:
  PlcBookDataTest() {
    options_.book_base = 400;
    options_.book_every = 1ms;
  }
  static std::vector<std::uint16_t> Words(float quantity_t, float density_kg_m3) {
    const auto quantity = std::bit_cast<std::uint32_t>(quantity_t),
               density = std::bit_cast<std::uint32_t>(density_kg_m3);
    return {static_cast<std::uint16_t>(quantity >> 16), static_cast<std::uint16_t>(quantity),
            static_cast<std::uint16_t>(density >> 16), static_cast<std::uint16_t>(density)};
  }
  /// Bin 3 with these in force.
  static BinSnapshot WithBookInForce(double book_mass_kg, double density_kg_m3) {
    BinSnapshot snapshot = Snapshot(3, 17);
    snapshot.book.in_force.book_mass_kg = book_mass_kg;
    snapshot.book.in_force.density_kg_m3 = density_kg_m3;
    snapshot.book.in_force.correction = 1.02;
    snapshot.book.in_force.loss_kg = 12;
    return snapshot;
  }
  FakePlc plc_;
};

TEST_F(PlcBookDataTest, ChangeIsCommittedUnderThePlcsName) {
  plc_.Set(400, Words(15.5F, 800));
  Start(plc_.Port());
  client_->Publish(WithBookInForce(15200, 790));
  ASSERT_TRUE(Eventually([&] { return !control_.committed().empty(); }));
  const auto committed = control_.committed()[0];
  EXPECT_EQ(committed.bin, 3);
  EXPECT_EQ(committed.book, (BookData{15500, 800, 1.02, 12}));
  EXPECT_EQ(committed.who, "plc 127.0.0.1:" + std::to_string(plc_.Port()));
}

TEST_F(PlcBookDataTest, SecondBinsFollowAfterFourRegisters) {
  plc_.Set(404, Words(7.5F, 650));
  Start(plc_.Port());
  client_->Publish(Snapshot(5, 1));
  ASSERT_TRUE(Eventually([&] { return !control_.committed().empty(); }));
  EXPECT_EQ(control_.committed()[0].bin, 5);
  EXPECT_EQ(control_.committed()[0].book.book_mass_kg, 7500);
}

TEST_F(PlcBookDataTest, WhatIsInForceIsNotCommittedAgain) {
  plc_.Set(400, Words(15.2F, 790));
  Start(plc_.Port());
  client_->Publish(WithBookInForce(15200, 790));
  ASSERT_TRUE(plc_.AwaitReads(5));
  EXPECT_THAT(control_.committed(), IsEmpty());
}

TEST_F(PlcBookDataTest, EmptyRegistersAreNotCommitted) {
  Start(plc_.Port());
  client_->Publish(WithBookInForce(15200, 790));
  ASSERT_TRUE(plc_.AwaitReads(5));
  EXPECT_THAT(control_.committed(), IsEmpty());
}

TEST_F(PlcBookDataTest, OutOfRangeIsNotCommitted) {
  plc_.Set(400, Words(-1, 790));
  Start(plc_.Port());
  client_->Publish(WithBookInForce(15200, 790));
  ASSERT_TRUE(plc_.AwaitReads(5));
  EXPECT_THAT(control_.committed(), IsEmpty());
}

TEST_F(PlcBookDataTest, RejectedFiguresAreNotCommittedAgain) {
  plc_.Set(400, Words(15.5F, 800));
  Start(plc_.Port());
  BinSnapshot rejected = WithBookInForce(15200, 790);
  rejected.book.commit = CommandResult::kRejected;
  client_->Publish(rejected);
  ASSERT_TRUE(plc_.AwaitReads(10));
  EXPECT_THAT(control_.committed(), SizeIs(1));
}

TEST_F(PlcBookDataTest, OtherFiguresAfterARejectionAreCommitted) {
  plc_.Set(400, Words(15.5F, 800));
  Start(plc_.Port());
  BinSnapshot rejected = WithBookInForce(15200, 790);
  rejected.book.commit = CommandResult::kRejected;
  client_->Publish(rejected);
  ASSERT_TRUE(Eventually([&] { return control_.committed().size() == 1; }));
  plc_.Set(400, Words(15.75F, 800));
  ASSERT_TRUE(Eventually([&] { return control_.committed().size() == 2; }));
  EXPECT_EQ(control_.committed()[1].book.book_mass_kg, 15750);
}

TEST_F(PlcBookDataTest, BusyCommitIsWaitedFor) {
  plc_.Set(400, Words(15.5F, 800));
  Start(plc_.Port());
  BinSnapshot busy = WithBookInForce(15200, 790);
  busy.book.commit = CommandResult::kBusy;
  client_->Publish(busy);
  ASSERT_TRUE(plc_.AwaitReads(5));
  EXPECT_THAT(control_.committed(), IsEmpty());
  busy.book.commit = CommandResult::kDone;
  client_->Publish(busy);
  EXPECT_TRUE(Eventually([&] { return !control_.committed().empty(); }));
}

TEST_F(PlcBookDataTest, FileThatWinsEndsTheReading) {
  plc_.Set(400, Words(15.5F, 800));
  options_.heartbeat = 5ms;
  Start(plc_.Port());
  BinSnapshot of_file = WithBookInForce(15200, 790);
  of_file.book.writable = false;
  client_->Publish(of_file);
  ASSERT_TRUE(plc_.AwaitWrites(10));
  EXPECT_EQ(plc_.Reads(), 0);
  EXPECT_THAT(control_.committed(), IsEmpty());
}

TEST_F(PlcBookDataTest, RefusedReadingDoesNotStopThePushing) {
  plc_.Refuse(400, 2);
  Start(plc_.Port());
  for (std::uint64_t n = 1; n <= 3; ++n) {
    client_->Publish(Snapshot(3, n));
    ASSERT_TRUE(plc_.AwaitWrites(n));
  }
  EXPECT_EQ(plc_.Connections(), 1);
  EXPECT_THAT(control_.committed(), IsEmpty());
}

}  // namespace
}  // namespace granary
