// What a well-behaved master gets.
#include "daemon/modbus/server.h"

#include <array>
#include <atomic>
#include <bit>
#include <cerrno>
#include <chrono>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "tests/daemon/modbus/client.h"
#include "tests/daemon/modbus/served.h"
#include "tests/daemon/modbus/snapshots.h"

namespace granary {
namespace {

using test::Bytes;
using test::Connect;
using test::RawClient;
using test::ReadOne;

Bin BinOf(int id, const std::string& name) {
  Bin bin;
  bin.id = id;
  bin.name = name;
  return bin;
}

/// Bins 3 and 5, the former measured; the clock stands 90 s after the measurement.
class ModbusServerTest : public ::testing::Test {
 protected:
  ModbusServerTest() { units_.Publish(test::GoodSnapshot()); }

  test::RecordingControl control_;
  ModbusTally tally_;
  ModbusUnits units_{test::kIdentity, {BinOf(3, "bay-3"), BinOf(5, "bay-5")}, control_, tally_, [] {
                       return test::kMeasuredAt + std::chrono::seconds{90};
                     }};
  ModbusServer server_{ListenTcp("127.0.0.1", 0), ModbusTcpOptions{}, units_, tally_};
};

TEST_F(ModbusServerTest, MasterReadsTheSummary) {
  const auto master = Connect(server_.Port());
  std::array<std::uint16_t, 65> words{};
  ASSERT_EQ(modbus_read_registers(master.get(), 0, 65, words.data()), 65) << modbus_strerror(errno);
  EXPECT_EQ(words[0], 1);
  EXPECT_EQ(words[5], 17);
  EXPECT_EQ(std::bit_cast<float>(test::U32At(&words[10])), 19.5F);
  EXPECT_EQ(test::U32At(&words[8]), 90U);
}

TEST_F(ModbusServerTest, InputRegistersAreTheSame) {
  const auto master = Connect(server_.Port());
  std::array<std::uint16_t, 65> holding{}, input{};
  ASSERT_EQ(modbus_read_registers(master.get(), 0, 65, holding.data()), 65);
  ASSERT_EQ(modbus_read_input_registers(master.get(), 0, 65, input.data()), 65);
  EXPECT_EQ(holding, input);
}

TEST_F(ModbusServerTest, WholeMapCanBeReadInBlocksOfAnySize) {
  const auto master = Connect(server_.Port());
  const auto expected = test::Encode(test::GoodSnapshot());
  for (const int size : {1, 2, 7, 64, 125}) {
    for (int address = 0; address < kRegisterCount; address += size == 1 ? 13 : size) {
      const int count = std::min(size, kRegisterCount - address);
      std::array<std::uint16_t, 125> words{};
      ASSERT_EQ(modbus_read_registers(master.get(), address, count, words.data()), count) << address << " " << size;
      for (int i = 0; i < count; ++i) {
        if (address + i >= 240 && address + i < 252) continue;  // the server's own counters move
        ASSERT_EQ(words[i], expected[address + i]) << address + i;
      }
    }
  }
}

TEST_F(ModbusServerTest, DiscreteInputsAreTheStatusBits) {
  const auto master = Connect(server_.Port());
  std::array<std::uint8_t, 48> bits{};
  ASSERT_EQ(modbus_read_input_bits(master.get(), 0, 48, bits.data()), 48) << modbus_strerror(errno);
  EXPECT_EQ(bits[0], 1);
  for (int bit = 1; bit < 48; ++bit) EXPECT_EQ(bits[bit], 0) << bit;
}

TEST_F(ModbusServerTest, AddressOutsideTheMapIsIllegal) {
  const auto master = Connect(server_.Port());
  std::uint16_t word = 0;
  EXPECT_EQ(modbus_read_registers(master.get(), 4000, 1, &word), -1);
  EXPECT_EQ(errno, EMBXILADD);
}

TEST_F(ModbusServerTest, WritingIsAnIllegalFunction) {
  const auto master = Connect(server_.Port());
  EXPECT_EQ(modbus_write_register(master.get(), 900, 1), -1);
  EXPECT_EQ(errno, EMBXILFUN);
}

TEST_F(ModbusServerTest, BadQuantityIsAnIllegalValue) {
  RawClient client(server_.Port());
  ASSERT_TRUE(client.Send({0, 9, 0, 0, 0, 6, 3, 3, 0, 0, 0, 126}));
  EXPECT_EQ(client.Receive(9), (Bytes{0, 9, 0, 0, 0, 3, 3, 0x83, 3}));
}

TEST_F(ModbusServerTest, UnitIsTheBin) {
  EXPECT_EQ(ReadOne(Connect(server_.Port(), 3).get(), 346), 3);
  EXPECT_EQ(ReadOne(Connect(server_.Port(), 5).get(), 346), 5);
}

TEST_F(ModbusServerTest, UnitsZeroAnd255AreTheFirstBin) {
  EXPECT_EQ(ReadOne(Connect(server_.Port(), 0).get(), 346), 3);
  EXPECT_EQ(ReadOne(Connect(server_.Port(), 255).get(), 346), 3);
}

TEST_F(ModbusServerTest, UnitOfNoBinFailsToRespond) {
  const auto master = Connect(server_.Port(), 4);
  std::uint16_t word = 0;
  EXPECT_EQ(modbus_read_registers(master.get(), 0, 1, &word), -1);
  EXPECT_EQ(errno, EMBXGTAR);
}

TEST_F(ModbusServerTest, BinSaysThatItWasNotMeasuredBeforeItIsPublished) {
  EXPECT_EQ(ReadOne(Connect(server_.Port(), 5).get(), 0), 1 << 6);
}

TEST_F(ModbusServerTest, PublishedFailureIsReadAsHeld) {
  units_.Publish(test::HeldSnapshot(Reason::kFrameMissing));
  const auto master = Connect(server_.Port());
  EXPECT_EQ(ReadOne(master.get(), 0), (1 << 1) | (1 << 12));
  EXPECT_EQ(ReadOne(master.get(), 2), 11);
}

TEST_F(ModbusServerTest, ServerIdIsReported) {
  const auto master = Connect(server_.Port());
  std::array<std::uint8_t, 253> id{};
  const int size = modbus_report_slave_id(master.get(), id.size(), id.data());
  ASSERT_GT(size, 2) << modbus_strerror(errno);
  EXPECT_EQ(id[0], 3);
  EXPECT_EQ(id[1], 0xFF);
  EXPECT_EQ(std::string(id.begin() + 2, id.begin() + size), "granaryd 0.1.0, depot-7, bay-3");
}

TEST_F(ModbusServerTest, DeviceIdentificationIsAnswered) {
  RawClient client(server_.Port());
  ASSERT_TRUE(client.Send({0, 1, 0, 0, 0, 5, 3, 43, 14, 4, 1}));
  const Bytes expected{0, 1, 0, 0, 0, 19, 3, 43, 14, 4, 0x83, 0, 0, 1, 1, 8, 'g', 'r', 'a', 'n', 'a', 'r', 'y', 'd'};
  Bytes with_length = expected;
  with_length[5] = static_cast<std::uint8_t>(expected.size() - 6);
  EXPECT_EQ(client.Receive(expected.size()), with_length);
}

TEST_F(ModbusServerTest, PipelinedRequestsAreAnsweredInOrder) {
  RawClient client(server_.Port());
  Bytes requests;
  constexpr int kRequests = 5000;  // 60 kB of requests, 55 kB of answers
  for (int i = 0; i < kRequests; ++i) {
    const auto high = static_cast<std::uint8_t>(i >> 8), low = static_cast<std::uint8_t>(i);
    requests.insert(requests.end(), {high, low, 0, 0, 0, 6, 3, 3, 0, 5, 0, 1});
  }
  ASSERT_TRUE(client.Send(requests));
  const Bytes answers = client.Receive(kRequests * 11);
  ASSERT_EQ(answers.size(), kRequests * 11U);
  for (int i = 0; i < kRequests; ++i) {
    ASSERT_EQ((answers[11 * i] << 8) | answers[11 * i + 1], i);
    ASSERT_EQ(answers[11 * i + 10], 17);
  }
}

TEST_F(ModbusServerTest, RequestFollowedByTheEndIsStillAnswered) {
  RawClient client(server_.Port());
  ASSERT_TRUE(client.Send({0, 9, 0, 0, 0, 6, 3, 3, 0, 5, 0, 1}));
  client.EndSending();
  EXPECT_EQ(client.Receive(100), (Bytes{0, 9, 0, 0, 0, 5, 3, 3, 2, 0, 17}));
}

TEST_F(ModbusServerTest, BlockIsOneMeasurementWhileAnotherThreadPublishes) {
  const auto publish = [&](int i) {
    auto snapshot = test::GoodSnapshot();
    snapshot.good->sequence = static_cast<std::uint64_t>(i);
    snapshot.good->volume_m3 = i;
    snapshot.good->volume_u95_m3 = i;
    units_.Publish(snapshot);
  };
  publish(1);
  std::atomic<bool> done = false;
  std::thread publisher([&] {
    for (int i = 1; !done; i = i % 60000 + 1) publish(i);
  });
  const auto master = Connect(server_.Port());
  int changes = 0;
  for (int i = 0, before = 0; i < 3000; ++i) {
    std::array<std::uint16_t, 65> words{};
    if (modbus_read_registers(master.get(), 0, 65, words.data()) != 65) {
      ADD_FAILURE() << modbus_strerror(errno);
      break;
    }
    EXPECT_EQ(words[5], words[64]);
    const float volume = std::bit_cast<float>(test::U32At(&words[10]));
    EXPECT_EQ(volume, std::bit_cast<float>(test::U32At(&words[62])));
    EXPECT_EQ(volume, words[5]);
    changes += words[5] != before;
    before = words[5];
  }
  done = true;
  publisher.join();
  EXPECT_GT(changes, 10) << "the publisher never ran beside the reader: the test shows nothing";
}

TEST_F(ModbusServerTest, CountersAreServed) {
  const auto master = Connect(server_.Port());
  ReadOne(master.get(), 0);
  ReadOne(master.get(), 0);
  EXPECT_EQ(ReadOne(master.get(), 243), 3);
  EXPECT_EQ(ReadOne(master.get(), 241), 1);
  EXPECT_EQ(tally_.Read().requests, 4U);
}

TEST(ModbusServer, StopsWithClientsConnected) {
  auto served = std::make_unique<test::Served>();
  RawClient silent(served->Port());
  ASSERT_TRUE(silent.Send({0, 1, 0}));
  served.reset();
  EXPECT_TRUE(silent.IsClosedInSilence());
}

TEST_F(ModbusServerTest, RefusesASocketThatDoesNotListen) {
  EXPECT_THROW(ModbusServer(FileDescriptor(socket(AF_INET, SOCK_STREAM, 0)), ModbusTcpOptions{}, units_, tally_),
               std::runtime_error);
}

TEST_F(ModbusServerTest, RefusesAnAllowListThatIsNone) {
  ModbusTcpOptions options;
  options.allow = {"depot"};
  EXPECT_THROW(ModbusServer(ListenTcp("127.0.0.1", 0), options, units_, tally_), std::invalid_argument);
}

TEST(ModbusUnits, RefusesToServeNoBins) {
  test::RecordingControl control;
  ModbusTally tally;
  EXPECT_THROW(ModbusUnits(test::kIdentity, {}, control, tally), std::invalid_argument);
}

}  // namespace
}  // namespace granary
