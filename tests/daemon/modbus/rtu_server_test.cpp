// The serial server end to end: libmodbus as master on the other end of a line, and raw bytes for what neighbours send.
#include <cerrno>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <modbus/modbus.h>
#include <termios.h>

#include "tests/daemon/modbus/rtu_line.h"

namespace granary::test {
namespace {

struct FreeModbus {
  void operator()(modbus_t* master) const {
    modbus_close(master);
    modbus_free(master);
  }
};
using Master = std::unique_ptr<modbus_t, FreeModbus>;

Master MasterOn(const Pty& line, int unit = kUs) {
  Master master(modbus_new_rtu(line.Path().c_str(), 115200, 'N', 8, 2));
  if (!master || modbus_connect(master.get()) != 0) throw std::runtime_error("libmodbus cannot open the line");
  modbus_set_slave(master.get(), unit);
  modbus_set_response_timeout(master.get(), kLineGuardMs / 1000, 0);
  return master;
}

/// libmodbus on one end of a cable, the server on the other.
struct Bus {
  explicit Bus(ModbusRtuOptions options = {}, bool echo = false) : cable(masters, servers, echo) {
    options.device = servers.Path();
    options.baud = 115200;
    server.emplace(options, bins.units, bins.tally);
    master = MasterOn(masters);
  }
  Pty masters, servers;
  Cable cable;
  RtuUnits bins;
  std::optional<RtuServer> server;
  Master master;
};

ModbusRtuOptions Writable() {
  ModbusRtuOptions options;
  options.write = true;
  return options;
}

/// Raw bytes on one end of a line, the server on the other.
struct RawBus {
  explicit RawBus(ModbusRtuOptions options = {}) {
    options.device = line.Path();
    options.baud = 115200;
    server.emplace(options, bins.units, bins.tally);
  }
  /// Asks for the sequence; any answer to what was sent before would come first.
  void ExpectOnlyThisIsAnswered(int address = kUs) {
    line.Send(ReadRequest(address, 5));
    const Bytes reply = ReadReply(address, {0, static_cast<std::uint8_t>(address == kUs ? 17 : 0)});
    EXPECT_EQ(line.Receive(reply.size()), reply);
    EXPECT_TRUE(line.IsSilent());
  }
  Pty line;
  RtuUnits bins;
  std::optional<RtuServer> server;
};

TEST(RtuServer, IsReadByLibmodbus) {
  Bus bus;
  std::uint16_t words[65] = {};
  ASSERT_EQ(modbus_read_registers(bus.master.get(), 0, 65, words), 65) << modbus_strerror(errno);
  EXPECT_EQ(words[5], 17);
  EXPECT_EQ(words[64], 17);
  EXPECT_EQ(U32At(words + 10), 0x419C0000U);  // 19.5 m³
  ASSERT_EQ(modbus_read_input_registers(bus.master.get(), 5, 1, words), 1) << modbus_strerror(errno);
  EXPECT_EQ(words[0], 17);
}

TEST(RtuServer, GivesTheLongestReplyWhole) {
  Bus bus;
  std::uint16_t words[125] = {};
  for (int i = 0; i < 20; ++i) {
    ASSERT_EQ(modbus_read_registers(bus.master.get(), 0, 125, words), 125) << modbus_strerror(errno);
  }
}

TEST(RtuServer, HearsFramesAsLibmodbusMakesThem) {
  Bus bus(Writable());
  std::uint16_t words[4] = {1, 2, 3, 4};
  std::uint8_t bits[16] = {};
  modbus_t* master = bus.master.get();
  std::vector<std::size_t> lengths;
  modbus_read_bits(master, 0, 16, bits), lengths.push_back(8);
  modbus_read_input_bits(master, 0, 16, bits), lengths.push_back(8);
  modbus_read_registers(master, 0, 4, words), lengths.push_back(8);
  modbus_read_input_registers(master, 0, 4, words), lengths.push_back(8);
  modbus_write_bit(master, 0, 1), lengths.push_back(8);
  modbus_write_register(master, 900, 1), lengths.push_back(8);
  modbus_write_bits(master, 0, 16, bits), lengths.push_back(11);
  modbus_write_registers(master, 920, 4, words), lengths.push_back(17);
  modbus_mask_write_register(master, 900, 0xFFFF, 1), lengths.push_back(10);
  modbus_write_and_read_registers(master, 900, 2, words, 0, 2, words), lengths.push_back(17);
  modbus_report_slave_id(master, sizeof bits, bits), lengths.push_back(4);

  std::span<const std::uint8_t> sent = bus.cable.Sent();
  for (const std::size_t length : lengths) {
    ASSERT_GE(sent.size(), length);
    EXPECT_EQ(RequestBytes(sent), length);
    EXPECT_EQ(Crc16(sent.first(length)), 0);
    sent = sent.subspan(length);
  }
  EXPECT_TRUE(sent.empty());
  EXPECT_EQ(bus.bins.Counters().rtu_requests, lengths.size());
  EXPECT_EQ(bus.bins.Counters().rtu_errors, 0U);
}

TEST(RtuServer, AnswersTheMasterBesideADeadNeighbour) {
  Bus bus;
  std::uint16_t word = 0;
  for (int i = 0; i < 20; ++i) {
    modbus_set_slave(bus.master.get(), kNeighbour);
    modbus_set_response_timeout(bus.master.get(), 0, 10'000);
    EXPECT_EQ(modbus_read_registers(bus.master.get(), 5, 1, &word), -1);
    modbus_set_slave(bus.master.get(), kUs);
    modbus_set_response_timeout(bus.master.get(), kLineGuardMs / 1000, 0);
    ASSERT_EQ(modbus_read_registers(bus.master.get(), 5, 1, &word), 1) << modbus_strerror(errno);
  }
  EXPECT_EQ(bus.bins.Counters().rtu_requests, 20U);
  EXPECT_EQ(bus.bins.Counters().rtu_others, 20U);
}

TEST(RtuServer, TakesWritesWhereTheLineMayWrite) {
  Bus bus(Writable());
  ASSERT_EQ(modbus_write_register(bus.master.get(), 900, 1), 1) << modbus_strerror(errno);
  const auto chosen = bus.bins.control.chosen();
  ASSERT_EQ(chosen.size(), 1U);
  EXPECT_EQ(chosen[0].bin, kUs);
  EXPECT_EQ(chosen[0].who, bus.servers.Path());
}

TEST(RtuServer, RefusesWritesWhereTheLineMayNot) {
  Bus bus;
  EXPECT_EQ(modbus_write_register(bus.master.get(), 900, 1), -1);
  EXPECT_THAT(bus.bins.control.chosen(), testing::IsEmpty());
  EXPECT_EQ(bus.bins.Counters().writes_refused, 1U);
}

TEST(RtuServer, DoesNotAnswerItsOwnEcho) {
  Bus bus(Writable(), true);
  for (int i = 0; i < 5; ++i) {
    // The master would take what is left of an endless talk for its next answer.
    ASSERT_EQ(modbus_write_register(bus.master.get(), 900, i % 4), 1) << modbus_strerror(errno);
    std::uint16_t word = 0;
    ASSERT_EQ(modbus_read_registers(bus.master.get(), 5, 1, &word), 1) << modbus_strerror(errno);
  }
  EXPECT_EQ(bus.bins.Counters().rtu_requests, 10U);
  EXPECT_EQ(bus.bins.Counters().rtu_errors, 0U);
}

TEST(RtuServer, AnswersEachOfItsBins) {
  RawBus bus;
  bus.ExpectOnlyThisIsAnswered(3);
  bus.ExpectOnlyThisIsAnswered(5);
}

TEST(RtuServer, AnswersNobodyElsesRequest) {
  RawBus bus;
  for (int address = 1; address < 256; ++address) {
    if (address != 3 && address != 5) bus.line.Send(ReadRequest(address, 5));
  }
  bus.ExpectOnlyThisIsAnswered();
  EXPECT_EQ(bus.bins.Counters().rtu_others, 245U);
}

TEST(RtuServer, AnswersOnlyTheUnitsOfItsLine) {
  ModbusRtuOptions options;
  options.units = {5};
  RawBus bus(options);
  bus.line.Send(ReadRequest(3, 5));
  bus.ExpectOnlyThisIsAnswered(5);
}

TEST(RtuServer, AnswersNoReadSentToAll) {
  RawBus bus(Writable());
  bus.line.Send(ReadRequest(0, 5));
  bus.ExpectOnlyThisIsAnswered();
}

TEST(RtuServer, CarriesOutAWriteSentToAllInSilence) {
  RawBus bus(Writable());
  bus.line.Send(WriteRequest(0));
  bus.ExpectOnlyThisIsAnswered();
  const auto chosen = bus.bins.control.chosen();
  ASSERT_EQ(chosen.size(), 2U);
  EXPECT_EQ(chosen[0].bin, 3);
  EXPECT_EQ(chosen[1].bin, 5);
}

TEST(RtuServer, LeavesAWriteSentToAllWhereTheLineMayNotWrite) {
  RawBus bus;
  bus.line.Send(WriteRequest(0));
  bus.ExpectOnlyThisIsAnswered();
  EXPECT_THAT(bus.bins.control.chosen(), testing::IsEmpty());
  EXPECT_EQ(bus.bins.Counters().writes_refused, 0U);
  EXPECT_EQ(bus.bins.Counters().rtu_others, 1U);
}

TEST(RtuServer, AnswersInTheMidstOfNeighboursAndNoise) {
  RawBus bus;
  const Bytes reply = ReadReply(kNeighbour, Joined({Bytes{9}, ReadRequest(kUs, 5), Bytes{9}}));
  for (int i = 0; i < 50; ++i) {
    bus.line.Send(Joined({ReadRequest(kNeighbour), reply}));
    bus.line.Send({static_cast<std::uint8_t>(i)});
    bus.ExpectOnlyThisIsAnswered();
  }
}

TEST(RtuServer, KeepsSilentWhenTheMasterGoesOnWhileItPonders) {
  const Pty line;
  std::atomic<bool> goes_on{true};
  // The clock is asked in the middle of an answer.
  RtuUnits bins([&] {
    if (goes_on.exchange(false)) line.Send(ReadRequest(kNeighbour));
    return kMeasuredAt;
  });
  goes_on = true;
  const RtuServer server(OptionsFor(line.Path()), bins.units, bins.tally);
  line.Send(ReadRequest(5, 5));
  while (bins.Counters().rtu_others == 0) std::this_thread::yield();
  line.Send(ReadRequest(kUs, 5));
  EXPECT_EQ(line.Receive(SequenceReply().size()), SequenceReply());
}

TEST(RtuServer, SetsTheLine) {
  RawBus bus;
  termios line{};
  ASSERT_EQ(tcgetattr(bus.line.Descriptor(), &line), 0);  // a pseudo terminal's ends share their settings
  EXPECT_EQ(cfgetospeed(&line), speed_t{B115200});
  EXPECT_EQ(line.c_cflag & CSIZE, tcflag_t{CS8});
  EXPECT_EQ(line.c_cflag & (CSTOPB | CRTSCTS), 0U);  // even parity, one stop bit
  EXPECT_EQ(line.c_lflag & (ICANON | ECHO | ISIG), 0U);
  EXPECT_EQ(line.c_oflag & OPOST, 0U);
  EXPECT_EQ(line.c_iflag & (IXON | IXOFF | ICRNL | INLCR | ISTRIP), 0U);
}

TEST(RtuServer, SetsTwoStopBitsWithoutParity) {
  ModbusRtuOptions options;
  options.parity = "none";
  RawBus bus(options);
  termios line{};
  ASSERT_EQ(tcgetattr(bus.line.Descriptor(), &line), 0);
  EXPECT_NE(line.c_cflag & CSTOPB, 0U);
}

}  // namespace
}  // namespace granary::test
