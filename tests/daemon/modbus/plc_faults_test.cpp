// A PLC that is dead, rude or set up otherwise: nobody waits for it, and it gets the newest figures when it is back.
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <spdlog/logger.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>

#include "daemon/modbus/plc_client.h"
#include "tests/daemon/modbus/plc_served.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using test::Eventually;
using test::FakePlc;
using test::PlcClientTest;
using Manner = FakePlc::Manner;

/// A port that was free a moment ago.
std::uint16_t FreePort() { return BoundPort(ListenTcp("127.0.0.1", 0).Get()); }

/// Everything that is logged while it lives.
class CapturedLog {
 public:
  CapturedLog() : before_(spdlog::default_logger()) {
    spdlog::set_default_logger(
        std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(stream_)));
  }
  ~CapturedLog() { spdlog::set_default_logger(before_); }
  CapturedLog(const CapturedLog&) = delete;
  CapturedLog& operator=(const CapturedLog&) = delete;
  /// To be called when nobody logs any more.
  [[nodiscard]] std::string Text() const { return stream_.str(); }

 private:
  std::ostringstream stream_;
  std::shared_ptr<spdlog::logger> before_;
};

int CountOf(const std::string& text, const std::string& part) {
  int count = 0;
  for (auto at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

TEST_F(PlcClientTest, AfterAnOutageTheNewestGoesFirstAndNothingElse) {
  const std::uint16_t port = FreePort();
  Start(port);
  for (std::uint64_t n = 1; n <= 100; ++n) client_->Publish(Snapshot(3, n));
  for (std::uint64_t n = 1; n <= 200; ++n) client_->Publish(Snapshot(5, n));
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_failures >= 3; }));
  FakePlc plc(port);
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_pushes == 2; }));
  const auto writes = plc.Writes();
  ASSERT_EQ(writes.size(), 2U);
  EXPECT_EQ(writes[0].address, 110);
  EXPECT_EQ(writes[0].words[0], 200);
  EXPECT_EQ(writes[1].address, 100);
  EXPECT_EQ(writes[1].words[0], 100);
}

TEST_F(PlcClientTest, PlcThatWasRestartedGetsAllBlocksAgain) {
  auto plc = std::make_unique<FakePlc>();
  const std::uint16_t port = plc->Port();
  Start(port);
  client_->Publish(Snapshot(3, 1));
  client_->Publish(Snapshot(5, 1));
  ASSERT_TRUE(plc->AwaitWrites(2));
  plc.reset();
  plc = std::make_unique<FakePlc>(port);
  client_->Publish(Snapshot(5, 2));
  ASSERT_TRUE(plc->AwaitWrites(2));
  EXPECT_EQ(plc->Writes()[0].address, 110);
  EXPECT_EQ(plc->Writes()[1].address, 100);
}

TEST_F(PlcClientTest, PublishDoesNotWaitForASilentPlc) {
  FakePlc plc(0, Manner::kSilent);
  Start(plc.Port());
  client_->Publish(Snapshot(3, 1));
  ASSERT_TRUE(plc.AwaitRequests(1));  // from here on the client waits for its answer, a minute long
  std::thread worker([&] {
    for (std::uint64_t n = 2; n <= 1000; ++n) client_->Publish(Snapshot(3, n));
  });
  worker.join();
  EXPECT_EQ(plc.Requests(), 1);
  EXPECT_EQ(tally_.Read().plc_failures, 0U);
}

TEST_F(PlcClientTest, EndDoesNotWaitForASilentPlc) {
  FakePlc plc(0, Manner::kSilent);
  options_.timeout = 1h;
  Start(plc.Port());
  client_->Publish(Snapshot(3, 1));
  ASSERT_TRUE(plc.AwaitRequests(1));
  client_.reset();
  EXPECT_EQ(tally_.Read().plc_failures, 0U);
}

/// Listens, with a queue that is full: what more wants to connect gets no answer, as from a dead machine.
class BlackHole {
 public:
  BlackHole() : listener_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in any{};
    any.sin_family = AF_INET;
    any.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (bind(listener_.Get(), reinterpret_cast<const sockaddr*>(&any), sizeof any) != 0) return;
    if (listen(listener_.Get(), 0) != 0) return;
    any.sin_port = htons(Port());
    for (int i = 0; i < 8 && !full_; ++i) {
      FileDescriptor filler(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
      if (connect(filler.Get(), reinterpret_cast<const sockaddr*>(&any), sizeof any) != 0) {
        pollfd ready{filler.Get(), POLLOUT, 0};
        full_ = poll(&ready, 1, 200) == 0;
      }
      fillers_.push_back(std::move(filler));
    }
  }
  [[nodiscard]] std::uint16_t Port() const { return BoundPort(listener_.Get()); }
  [[nodiscard]] bool IsBlack() const { return full_; }

 private:
  FileDescriptor listener_;
  std::vector<FileDescriptor> fillers_;
  bool full_ = false;
};

TEST_F(PlcClientTest, BlackHoleIsAFailure) {
  const BlackHole hole;
  if (!hole.IsBlack()) GTEST_SKIP() << "this kernel answers a connect to a full queue";
  options_.timeout = 100ms;
  Start(hole.Port());
  client_->Publish(Snapshot(3, 1));
  EXPECT_TRUE(Eventually([&] { return tally_.Read().plc_failures >= 2; }));
  EXPECT_EQ(tally_.Read().plc_connected, 0U);
}

TEST_F(PlcClientTest, EndDoesNotWaitForABlackHole) {
  const BlackHole hole;
  if (!hole.IsBlack()) GTEST_SKIP() << "this kernel answers a connect to a full queue";
  options_.timeout = 1h;
  Start(hole.Port());
  client_->Publish(Snapshot(3, 1));
  client_.reset();
  EXPECT_EQ(tally_.Read().plc_failures, 0U);
}

TEST_F(PlcClientTest, NameWithoutAddressIsAFailure) {
  options_.address = "plc.invalid:502";
  client_ = std::make_unique<PlcClient>(options_, std::vector<Bin>{Snapshot(3, 0).bin}, test::kIdentity, control_,
                                        tally_, std::function<UtcTime()>{}, limits_, 1);
  client_->Publish(Snapshot(3, 1));
  EXPECT_TRUE(Eventually([&] { return tally_.Read().plc_failures >= 1; }));
}

TEST_F(PlcClientTest, LostConnectionIsResetSoThatNothingOldArrivesLater) {
  options_.timeout = 100ms;
  FakePlc plc(0, Manner::kSilent);
  Start(plc.Port());
  client_->Publish(Snapshot(3, 1));
  EXPECT_TRUE(plc.AwaitResets(1));
}

TEST_F(PlcClientTest, DripIsCutOffAtTheTimeout) {
  options_.timeout = 100ms;
  limits_.first_retry = limits_.longest_retry = 1h;
  FakePlc plc(0, Manner::kDrips);
  Start(plc.Port());
  client_->Publish(Snapshot(3, 1));
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_failures == 1; }));
  EXPECT_LT(plc.Dripped(), FakePlc::kDrippedAnswer);
}

/// Each manner that breaks a connection, and a word of what is logged.
struct Misbehaviour {
  Manner manner;
  const char* words;
};
class PlcMisbehaves : public PlcClientTest, public ::testing::WithParamInterface<Misbehaviour> {};

TEST_P(PlcMisbehaves, IsLoggedOnceAndOverWhenItIs) {
  const CapturedLog log;
  options_.timeout = 100ms;
  FakePlc plc(0, GetParam().manner);
  Start(plc.Port());
  client_->Publish(Snapshot(3, 1));
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_failures >= 3; }));
  EXPECT_EQ(tally_.Read().plc_pushes, 0U);
  plc.Behave(Manner::kGood);
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_pushes == 1; }));
  client_.reset();
  EXPECT_EQ(plc.At(100), 1);
  EXPECT_EQ(CountOf(log.Text(), GetParam().words), 1) << log.Text();
  EXPECT_EQ(CountOf(log.Text(), "works again"), 1) << log.Text();
}

INSTANTIATE_TEST_SUITE_P(
    PlcClient, PlcMisbehaves,
    ::testing::Values(Misbehaviour{Manner::kSilent, "write of holding registers 100 to 103: no answer within 100 ms"},
                      Misbehaviour{Manner::kRubbish, "the answer is no Modbus"},
                      Misbehaviour{Manner::kWrongTransaction, "the answer is no Modbus"},
                      Misbehaviour{Manner::kClosesInTheMiddle, "the PLC has closed the connection"},
                      Misbehaviour{Manner::kClosesAtOnce, "the PLC has closed the connection"}),
    [](const auto& param) {
      switch (param.param.manner) {
        case Manner::kSilent:
          return "Silent";
        case Manner::kRubbish:
          return "Rubbish";
        case Manner::kWrongTransaction:
          return "WrongTransaction";
        case Manner::kClosesInTheMiddle:
          return "ClosesInTheMiddle";
        default:
          return "ClosesAtOnce";
      }
    });

TEST_F(PlcClientTest, RefusalKeepsTheConnectionAndTheOtherBins) {
  limits_.longest_retry = 1h;  // what is configured wrong is tried again that late
  FakePlc plc;
  plc.Refuse(100, 2);
  Start(plc.Port());
  client_->Publish(Snapshot(3, 9));
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_failures == 1; }));
  for (std::uint64_t n = 1; n <= 3; ++n) {
    client_->Publish(Snapshot(3, 9 + n));
    client_->Publish(Snapshot(5, n));
    ASSERT_TRUE(plc.AwaitWrites(n));
  }
  EXPECT_EQ(plc.Connections(), 1);
  EXPECT_EQ(plc.Requests(), 4);
  EXPECT_EQ(tally_.Read().plc_failures, 1U);
  EXPECT_EQ(tally_.Read().plc_connected, 1U);
}

TEST_F(PlcClientTest, RefusalIsNamedWithRegisterAndMeaning) {
  const CapturedLog log;
  FakePlc plc;
  plc.Refuse(102, 2);
  Start(plc.Port());
  client_->Publish(Snapshot(3, 9));
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_failures >= 3; }));
  client_.reset();
  EXPECT_EQ(CountOf(log.Text(),
                    "bin 3: write of holding registers 100 to 103 refused with exception 02, illegal data "
                    "address"),
            1)
      << log.Text();
}

TEST_F(PlcClientTest, BusyPlcIsTriedAgain) {
  FakePlc plc;
  plc.Refuse(100, 6);
  Start(plc.Port());
  client_->Publish(Snapshot(3, 9));
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_failures >= 2; }));
  plc.Refuse(100, 0);
  EXPECT_TRUE(Eventually([&] { return tally_.Read().plc_pushes == 1; }));
  EXPECT_EQ(plc.Connections(), 1);
}

TEST_F(PlcClientTest, ReadBackNamesTheRegisterThatDiffers) {
  const CapturedLog log;
  options_.read_back = true;
  FakePlc plc;
  plc.Stick(101, 0x1234);
  Start(plc.Port());
  client_->Publish(Snapshot(3, 17));
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_failures >= 3; }));
  EXPECT_EQ(tally_.Read().plc_pushes, 0U);
  plc.Unstick();
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_pushes == 1; }));
  client_.reset();
  EXPECT_EQ(CountOf(log.Text(), "bin 3: holding register 101 (volume) reads back 0x1234, written was 0x419C"), 1)
      << log.Text();
}

/// Bins that are never ready.
class RefusingControl : public BinControl {
 public:
  bool Ask(int, BinCommand, const std::string&) override { return false; }
  bool CommitBook(int, const BookData&, const std::string&) override { return ++refused, false; }
  bool SetFormat(int, const RegisterFormat&, const std::string&) override { return false; }
  std::atomic<int> refused = 0;
};

TEST_F(PlcClientTest, CommitThatIsNotTakenIsTriedAgain) {
  RefusingControl control;
  options_.book_base = 400;
  options_.book_every = 1ms;
  FakePlc plc;
  plc.Set(400, {0x4178, 0, 0x4448, 0});  // 15.5 t, 800 kg/m³
  options_.address = "127.0.0.1:" + std::to_string(plc.Port());
  PlcClient client(options_, {Snapshot(3, 0).bin}, test::kIdentity, control, tally_, {}, limits_, 1);
  client.Publish(Snapshot(3, 17));
  EXPECT_TRUE(Eventually([&] { return control.refused >= 3; }));
}

TEST_F(PlcClientTest, BookRefusedIsLoggedOnce) {
  const CapturedLog log;
  options_.book_base = 400;
  options_.book_every = 1ms;
  FakePlc plc;
  plc.Set(400, {0x4178, 0, 0x4748, 0});
  Start(plc.Port());
  client_->Publish(Snapshot(3, 17));
  ASSERT_TRUE(plc.AwaitReads(5));
  client_.reset();
  EXPECT_EQ(CountOf(log.Text(), "book data 15.5 t, 51200 kg/m³ refused: density_kg_m3: must be 1 to 2000"), 1)
      << log.Text();
}

TEST_F(PlcClientTest, BookSourceFileIsLoggedOnce) {
  const CapturedLog log;
  options_.book_base = 400;
  options_.book_every = 1ms;
  options_.heartbeat = 5ms;
  FakePlc plc;
  Start(plc.Port());
  BinSnapshot of_file = Snapshot(3, 17);
  of_file.book.writable = false;
  client_->Publish(of_file);
  ASSERT_TRUE(plc.AwaitWrites(10));
  client_.reset();
  EXPECT_EQ(CountOf(log.Text(), "book_source = \"file\" wins"), 1) << log.Text();
}

TEST_F(PlcClientTest, PlcThatDiesOnReadingIsPushedToAllTheSame) {
  const CapturedLog log;
  options_.timeout = 100ms;
  options_.book_base = 400;
  options_.book_every = 10ms;
  FakePlc plc;
  plc.Ignore(400);
  Start(plc.Port());
  client_->Publish(Snapshot(3, 1));
  ASSERT_TRUE(Eventually([&] { return tally_.Read().plc_failures >= 2; }));
  client_->Publish(Snapshot(3, 2));
  EXPECT_TRUE(Eventually([&] { return plc.At(100) == 2; }));
  client_.reset();
  EXPECT_EQ(CountOf(log.Text(), "read of holding registers 400 to 403: no answer within 100 ms"), 1) << log.Text();
}

}  // namespace
}  // namespace granary
