// What everybody else gets, and that a good master never notices.
#include <algorithm>
#include <chrono>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <fcntl.h>
#include <gtest/gtest.h>

#include "daemon/modbus/server.h"
#include "tests/daemon/modbus/client.h"
#include "tests/daemon/modbus/served.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using test::Bytes;
using test::Connect;
using test::kReadSequence;
using test::kSequence;
using test::RawClient;
using test::ReadOne;

std::unique_ptr<test::Served> Serve(ModbusLimits limits = {}, const ModbusTcpOptions& options = {}) {
  return std::make_unique<test::Served>(limits, options);
}

void ExpectClosedAsMalformed(const Bytes& bytes) {
  const auto server = Serve();
  RawClient client(server->Port());
  ASSERT_TRUE(client.Send(bytes));
  EXPECT_TRUE(client.IsClosedInSilence());
  EXPECT_EQ(server->Counters().malformed, 1U);
}

TEST(ModbusServerFaults, WrongProtocolIdIsClosed) { ExpectClosedAsMalformed({0, 1, 0, 7, 0, 6, 3, 3, 0, 0, 0, 1}); }

TEST(ModbusServerFaults, LengthZeroIsClosed) { ExpectClosedAsMalformed({0, 1, 0, 0, 0, 0, 3, 3, 0, 0, 0, 1}); }

TEST(ModbusServerFaults, LengthTooLargeIsClosed) { ExpectClosedAsMalformed({0, 1, 0, 0, 1, 0, 3, 3, 0, 0, 0, 1}); }

TEST(ModbusServerFaults, GoodRequestBeforeTheMalformedOneIsAnswered) {
  const auto server = Serve();
  RawClient client(server->Port());
  Bytes bytes = kReadSequence;
  bytes.insert(bytes.end(), {0, 1, 0, 7, 0, 6});
  ASSERT_TRUE(client.Send(bytes));
  EXPECT_EQ(client.Receive(100), kSequence);
}

TEST(ModbusServerFaults, HalfAFrameAndSilenceIsClosedAtTheDeadline) {
  const auto server = Serve({.frame_deadline = 30ms});
  RawClient client(server->Port());
  ASSERT_TRUE(client.Send({0, 9, 0, 0, 0, 6, 3}));
  EXPECT_TRUE(client.IsClosedInSilence());
  EXPECT_EQ(server->Counters().timed_out, 1U);
}

TEST(ModbusServerFaults, DripOfBytesDoesNotExtendTheDeadline) {
  const auto server = Serve({.frame_deadline = 50ms});
  RawClient client(server->Port());
  // A frame of 260 bytes that is never finished: a byte whenever the server has been quiet for 5 ms.
  ASSERT_TRUE(client.Send({0, 9, 0, 0, 0, 254}));
  bool closed = false;
  for (int i = 0; i < 250 && !closed; ++i) {
    pollfd ready{client.Socket(), POLLIN, 0};
    closed = poll(&ready, 1, 5) == 1 || !client.Send({3});
  }
  EXPECT_TRUE(closed);
  EXPECT_EQ(server->Counters().timed_out, 1U);
}

TEST(ModbusServerFaults, RequestInSingleBytesIsServed) {
  const auto server = Serve({.frame_deadline = 20s});
  RawClient client(server->Port());
  for (const auto byte : kReadSequence) ASSERT_TRUE(client.Send({byte}));
  EXPECT_EQ(client.Receive(kSequence.size()), kSequence);
}

TEST(ModbusServerFaults, SlowClientDoesNotHoldUpAnother) {
  const auto server = Serve({.frame_deadline = 20s});
  RawClient slow(server->Port());
  const auto master = Connect(server->Port());
  for (std::size_t i = 0; i + 1 < kReadSequence.size(); ++i) {
    ASSERT_TRUE(slow.Send({kReadSequence[i]}));
    EXPECT_EQ(ReadOne(master.get(), 5), 17);
  }
  ASSERT_TRUE(slow.Send({kReadSequence.back()}));
  EXPECT_EQ(slow.Receive(kSequence.size()), kSequence);
}

TEST(ModbusServerFaults, IdleClientIsClosed) {
  const auto server = Serve({.idle_timeout = 30ms});
  RawClient client(server->Port());
  EXPECT_TRUE(client.IsClosedInSilence());
  EXPECT_EQ(server->Counters().timed_out, 1U);
}

TEST(ModbusServerFaults, ClientThatTakesNoAnswersIsClosed) {
  const auto server = Serve({.stall_deadline = 100ms, .max_unsent_bytes = 4096});
  RawClient greedy(server->Port(), 4096);
  const auto master = Connect(server->Port());
  Bytes requests;
  for (int i = 0; i < 1000; ++i) requests.insert(requests.end(), {0, 9, 0, 0, 0, 6, 3, 3, 0, 0, 0, 125});
  // Until the server closes: sending stalls once every buffer between the two is full.
  while (greedy.Send(requests)) {
  }
  EXPECT_EQ(server->Counters().timed_out, 1U);
  EXPECT_EQ(ReadOne(master.get(), 5), 17);
}

TEST(ModbusServerFaults, ThousandGarbageFramesDoNotDisturbAGoodClient) {
  const auto server = Serve({.frame_deadline = 20s});
  const auto master = Connect(server->Port());
  std::mt19937 random(7);
  for (int i = 0; i < 1000; ++i) {
    Bytes garbage(1 + random() % 300);
    std::generate(garbage.begin(), garbage.end(), [&] { return static_cast<std::uint8_t>(random()); });
    // Half of them get past the header, so that the answering sees rubbish too.
    if (i % 2 == 0 && garbage.size() >= 8) {
      const std::size_t length = std::min<std::size_t>(garbage.size() - 6, 254);
      garbage[2] = garbage[3] = garbage[4] = 0;
      garbage[5] = static_cast<std::uint8_t>(length);
      garbage[6] = 3;
    }
    RawClient vandal(server->Port());
    (void)vandal.Send(garbage);
    ASSERT_EQ(ReadOne(master.get(), 5), 17) << "after " << i;
  }
  EXPECT_GT(server->Counters().malformed, 400U);
}

TEST(ModbusServerFaults, AddressThatIsNotAllowedIsRefused) {
  ModbusTcpOptions options;
  options.allow = {"10.0.0.0/8"};
  const auto server = Serve({}, options);
  RawClient client(server->Port());
  EXPECT_TRUE(client.IsClosedInSilence());
  EXPECT_EQ(server->Counters().refused, 1U);
  EXPECT_EQ(server->Counters().clients, 0U);
}

TEST(ModbusServerFaults, NewcomerTakesThePlaceOfTheOneThatNeverAsked) {
  ModbusTcpOptions options;
  options.max_clients = 2;
  const auto server = Serve({}, options);
  const auto master = Connect(server->Port());
  EXPECT_EQ(ReadOne(master.get(), 5), 17);
  RawClient silent(server->Port());
  RawClient newcomer(server->Port());
  ASSERT_TRUE(newcomer.Send(kReadSequence));
  EXPECT_EQ(newcomer.Receive(kSequence.size()), kSequence);
  EXPECT_TRUE(silent.IsClosedInSilence());
  EXPECT_EQ(ReadOne(master.get(), 5), 17);
  EXPECT_EQ(server->Counters().evicted, 1U);
}

TEST(ModbusServerFaults, LongestSilentClientMakesRoom) {
  ModbusTcpOptions options;
  options.max_clients = 2;
  const auto server = Serve({}, options);
  RawClient first(server->Port()), second(server->Port());
  for (RawClient* client : {&second, &first, &second}) {
    ASSERT_TRUE(client->Send(kReadSequence));
    EXPECT_EQ(client->Receive(kSequence.size()), kSequence);
  }
  RawClient third(server->Port());
  EXPECT_TRUE(first.IsClosedInSilence());
  ASSERT_TRUE(second.Send(kReadSequence));
  EXPECT_EQ(second.Receive(kSequence.size()), kSequence);
}

TEST(ModbusServerFaults, FloodOfSilentConnectionsLeavesThePollingMasterAlone) {
  const auto server = Serve();
  const auto master = Connect(server->Port());
  EXPECT_EQ(ReadOne(master.get(), 5), 17);
  std::vector<std::unique_ptr<RawClient>> flood;
  for (int i = 0; i < 200; ++i) flood.push_back(std::make_unique<RawClient>(server->Port()));
  EXPECT_EQ(ReadOne(master.get(), 5), 17);
}

}  // namespace
}  // namespace granary
