// Modbus/TCP Security over real sockets: who gets in, who may write, and that nobody else is kept waiting.
#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "daemon/modbus/server.h"
#include "tests/daemon/modbus/certificates.h"
#include "tests/daemon/modbus/served.h"
#include "tests/daemon/modbus/tls_client.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using test::Bytes;
using test::TlsClient;

const Bytes kReadSequence{0, 9, 0, 0, 0, 6, 3, 3, 0, 5, 0, 1};
const Bytes kSequence{0, 9, 0, 0, 0, 5, 3, 3, 2, 0, 17};
const Bytes kWriteByteOrder{0, 9, 0, 0, 0, 6, 3, 6, 0x03, 0x84, 0, 1};  // register 900 := 1, answered by its echo
const Bytes kIllegalFunction{0, 9, 0, 0, 0, 3, 3, 0x86, 1};

class TlsServerTest : public ::testing::Test {
 protected:
  test::Served& Serve(ModbusLimits limits = {}) {
    const test::Issued server = ca_.Issue("server");
    options_.certificate = server.certificate;
    options_.key = server.key;
    options_.client_ca = ca_.File();
    served_ = std::make_unique<test::Served>(limits, options_.tcp, LoadTls(options_));
    return *served_;
  }
  TlsClient Client(const test::Issued& own) { return {served_->Port(), ca_.File(), {.own = own}}; }
  /// Waits until the server has counted.
  void ExpectRefused() {
    const auto guard = std::chrono::steady_clock::now() + std::chrono::milliseconds{test::kGuardMs};
    while (served_->Counters().refused == 0 && std::chrono::steady_clock::now() < guard) std::this_thread::yield();
    EXPECT_EQ(served_->Counters().refused, 1U);
    EXPECT_EQ(served_->Counters().requests, 0U);
  }
  /// What a write of register 900 is answered with.
  void ExpectWritten(const test::Issued& own, const Bytes& answer) {
    Serve();
    EXPECT_EQ(Client(own).Ask(kWriteByteOrder, answer.size()), answer);
    EXPECT_EQ(served_->control.chosen().size(), answer == kWriteByteOrder ? 1U : 0U);
  }

  test::TemporaryFolder folder_;
  test::Authority ca_{folder_.Path(), "ca"};
  ModbusTlsOptions options_;
  std::unique_ptr<test::Served> served_;
};

TEST_F(TlsServerTest, ClientWithACertificateIsServed) {
  Serve();
  TlsClient client = Client(ca_.Issue("client"));
  EXPECT_EQ(client.Ask(kReadSequence, kSequence.size()), kSequence);
  EXPECT_EQ(client.Ask(kReadSequence, kSequence.size()), kSequence);
  EXPECT_STREQ(SSL_get_version(client.Session()), "TLSv1.3");
}

TEST_F(TlsServerTest, PipelinedRequestsAreAnsweredInOrder) {
  Serve();
  TlsClient client = Client(ca_.Issue("client"));
  Bytes requests;
  constexpr int kRequests = 1300;  // 15.6 kB: one record of TLS, of which the server reads a part at a time
  for (int i = 0; i < kRequests; ++i) {
    const auto high = static_cast<std::uint8_t>(i >> 8), low = static_cast<std::uint8_t>(i);
    requests.insert(requests.end(), {high, low, 0, 0, 0, 6, 3, 3, 0, 5, 0, 1});
  }
  const Bytes answers = client.Ask(requests, kRequests * 11);
  ASSERT_EQ(answers.size(), kRequests * 11U);
  for (int i = 0; i < kRequests; ++i) ASSERT_EQ((answers[11 * i] << 8) | answers[11 * i + 1], i);
}

TEST_F(TlsServerTest, ClientWithoutACertificateIsRefused) {
  Serve();
  TlsClient client(served_->Port(), ca_.File(), {});
  EXPECT_TRUE(client.Ask(kReadSequence, kSequence.size()).empty());
  ExpectRefused();
}

TEST_F(TlsServerTest, CertificateOfAForeignAuthorityIsRefused) {
  Serve();
  test::Authority foreign(folder_.Path(), "foreign");
  EXPECT_TRUE(Client(foreign.Issue("stranger")).Ask(kReadSequence, kSequence.size()).empty());
  ExpectRefused();
}

TEST_F(TlsServerTest, ExpiredCertificateIsRefused) {
  Serve();
  const auto expired = ca_.Issue("old", {.valid_from = -7200s, .valid_until = -3600s});
  EXPECT_TRUE(Client(expired).Ask(kReadSequence, kSequence.size()).empty());
  ExpectRefused();
}

TEST_F(TlsServerTest, OlderVersionOfTlsIsRefused) {
  Serve();
  TlsClient client(served_->Port(), ca_.File(), {.own = ca_.Issue("client"), .version = TLS1_2_VERSION});
  EXPECT_TRUE(client.Ask(kReadSequence, kSequence.size()).empty());
  ExpectRefused();
}

TEST_F(TlsServerTest, PlainModbusOnItsPortIsClosed) {
  Serve();
  test::RawClient client(served_->Port());
  ASSERT_TRUE(client.Send(kReadSequence));
  EXPECT_LE(client.Receive(100).size(), 7U) << "more than the alert that TLS closes with";
  ExpectRefused();
}

TEST_F(TlsServerTest, RubbishAfterTheHandshakeIsClosedAsMalformed) {
  Serve();
  TlsClient client = Client(ca_.Issue("client"));
  EXPECT_EQ(client.Ask(kReadSequence, kSequence.size()), kSequence);
  ASSERT_TRUE(client.Raw().Send({0x17, 3, 3, 0, 4, 1, 2, 3, 4}));  // a record that nobody encrypted
  EXPECT_LE(client.Raw().Receive(100).size(), 30U) << "more than an alert";
  EXPECT_EQ(served_->Counters().malformed, 1U);
}

TEST_F(TlsServerTest, HalfAHandshakeAndSilenceIsClosedAtTheDeadline) {
  Serve({.handshake_deadline = 50ms});
  test::RawClient client(served_->Port());
  ASSERT_TRUE(client.Send({0x16, 3, 1, 2, 0, 1, 0, 1, 0xFC}));  // how a ClientHello of 512 bytes begins
  EXPECT_TRUE(client.IsClosedInSilence());
  EXPECT_EQ(served_->Counters().timed_out, 1U);
}

TEST_F(TlsServerTest, ConnectionThatSaysNothingIsClosedAtTheDeadline) {
  Serve({.handshake_deadline = 50ms});
  EXPECT_TRUE(test::RawClient(served_->Port()).IsClosedInSilence());
}

TEST_F(TlsServerTest, GoodClientIsServedBesideHalfHandshakes) {
  Serve();
  TlsClient client = Client(ca_.Issue("client"));
  EXPECT_EQ(client.Ask(kReadSequence, kSequence.size()), kSequence);
  std::vector<std::unique_ptr<test::RawClient>> stuck;
  for (int i = 0; i < 100; ++i) {
    stuck.push_back(std::make_unique<test::RawClient>(served_->Port()));
    ASSERT_TRUE(stuck.back()->Send({0x16, 3, 1, 2, 0, 1, 0, 1, 0xFC}));
    ASSERT_EQ(client.Ask(kReadSequence, kSequence.size()), kSequence) << i;
  }
}

TEST_F(TlsServerTest, SessionsCannotBeResumed) {
  Serve();
  TlsClient client = Client(ca_.Issue("client"));
  EXPECT_EQ(client.Ask(kReadSequence, kSequence.size()), kSequence);
  EXPECT_FALSE(client.WasResumable());
}

TEST_F(TlsServerTest, GoodbyeIsAnswered) {
  Serve();
  TlsClient client = Client(ca_.Issue("client"));
  EXPECT_EQ(client.Ask(kReadSequence, kSequence.size()), kSequence);
  EXPECT_TRUE(client.SayGoodbye());
}

TEST_F(TlsServerTest, IdleClientHearsThatItIsClosed) {
  Serve({.idle_timeout = 500ms});
  TlsClient client = Client(ca_.Issue("client"));
  EXPECT_EQ(client.Ask(kReadSequence, kSequence.size()), kSequence);
  EXPECT_TRUE(client.Ask({}, 1).empty());
  EXPECT_NE(SSL_get_shutdown(client.Session()) & SSL_RECEIVED_SHUTDOWN, 0);
}

TEST_F(TlsServerTest, RightRoleWrites) {
  options_.tcp.write_allow = {"127.0.0.0/8"};
  options_.write_roles = {"Operator"};
  ExpectWritten(ca_.Issue("client", {.role = "Operator"}), kWriteByteOrder);
}

TEST_F(TlsServerTest, WrongRoleGetsIllegalFunction) {
  options_.tcp.write_allow = {"127.0.0.0/8"};
  options_.write_roles = {"Operator"};
  ExpectWritten(ca_.Issue("client", {.role = "Viewer"}), kIllegalFunction);
}

TEST_F(TlsServerTest, NoRoleGetsIllegalFunction) {
  options_.tcp.write_allow = {"127.0.0.0/8"};
  options_.write_roles = {"Operator"};
  ExpectWritten(ca_.Issue("client"), kIllegalFunction);
}

TEST_F(TlsServerTest, RightRoleFromAnAddressThatMayNotWriteGetsIllegalFunction) {
  options_.tcp.write_allow = {"10.0.0.0/8"};
  options_.write_roles = {"Operator"};
  ExpectWritten(ca_.Issue("client", {.role = "Operator"}), kIllegalFunction);
}

TEST_F(TlsServerTest, WithoutWriteRolesTheAddressIsEnough) {
  options_.tcp.write_allow = {"127.0.0.0/8"};
  ExpectWritten(ca_.Issue("client"), kWriteByteOrder);
}

}  // namespace
}  // namespace granary
