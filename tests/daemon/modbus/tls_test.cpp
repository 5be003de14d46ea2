// Faults in certificate files, and roles in certificates.
#include "daemon/modbus/tls.h"

#include <fstream>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/modbus/certificates.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

class LoadTlsTest : public ::testing::Test {
 protected:
  LoadTlsTest() { Use(ca_.Issue("server")); }

  void Use(const test::Issued& server) {
    options_.certificate = server.certificate;
    options_.key = server.key;
    options_.client_ca = ca_.File();
  }
  std::string Fault() const {
    try {
      (void)LoadTls(options_);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return {};
  }
  std::filesystem::path Text(const std::string& name, const std::string& text) const {
    std::ofstream(folder_.Path() / name) << text;
    return folder_.Path() / name;
  }

  test::TemporaryFolder folder_;
  test::Authority ca_{folder_.Path(), "ca"};
  ModbusTlsOptions options_;
};

TEST_F(LoadTlsTest, TakesAGoodSet) { EXPECT_EQ(Fault(), ""); }

TEST_F(LoadTlsTest, MissingFileIsNamedWithItsKeyAndCause) {
  options_.certificate = folder_.Path() / "nowhere.pem";
  EXPECT_EQ(Fault(), "modbus.tls.certificate: " + options_.certificate.string() + ": No such file or directory");
}

TEST_F(LoadTlsTest, MissingKeyIsNamed) {
  options_.key = folder_.Path() / "nowhere.key";
  EXPECT_EQ(Fault(), "modbus.tls.key: " + options_.key.string() + ": No such file or directory");
}

TEST_F(LoadTlsTest, CertificateThatIsNoPemIsNamed) {
  options_.certificate = Text("text.pem", "no certificate\n");
  EXPECT_THAT(Fault(), AllOf(StartsWith("modbus.tls.certificate: "), HasSubstr("text.pem: is no certificate in PEM: "),
                             HasSubstr("no start line")));
}

TEST_F(LoadTlsTest, KeyThatIsNoPemIsNamed) {
  options_.key = Text("text.key", "no key\n");
  EXPECT_THAT(Fault(), AllOf(StartsWith("modbus.tls.key: "), HasSubstr("text.key: is no key in PEM: ")));
}

TEST_F(LoadTlsTest, KeyOfAnotherCertificateIsRefused) {
  options_.key = ca_.Issue("other").key;
  EXPECT_THAT(Fault(), AllOf(StartsWith("modbus.tls.key: "), HasSubstr("does not belong to"), HasSubstr("server.pem"),
                             HasSubstr("key values mismatch")));
}

TEST_F(LoadTlsTest, EncryptedKeyIsRefusedWithoutAsking) {
  test::WriteKey(test::MakeKey().get(), options_.key, "secret");
  EXPECT_THAT(Fault(), HasSubstr("needs a passphrase, for which a daemon cannot ask"));
}

TEST_F(LoadTlsTest, ExpiredCertificateIsRefused) {
  Use(ca_.Issue("old", {.valid_from = -7200s, .valid_until = -3600s}));
  EXPECT_THAT(Fault(), AllOf(StartsWith("modbus.tls.certificate: "), HasSubstr("old.pem: expired at ")));
}

TEST_F(LoadTlsTest, CertificateOfTheFutureIsRefused) {
  Use(ca_.Issue("new", {.valid_from = 3600s, .valid_until = 7200s}));
  EXPECT_THAT(Fault(), HasSubstr("new.pem: is not valid before "));
}

TEST_F(LoadTlsTest, EmptyClientCaIsRefused) {
  options_.client_ca = Text("empty.pem", "");
  EXPECT_THAT(Fault(), AllOf(StartsWith("modbus.tls.client_ca: "), HasSubstr("empty.pem: is no certificate in PEM: ")));
}

TEST_F(LoadTlsTest, SeveralClientCasAreTaken) {
  const test::Authority other(folder_.Path(), "other-ca");
  std::ofstream both(folder_.Path() / "both.pem");
  both << std::ifstream(ca_.File()).rdbuf() << std::ifstream(other.File()).rdbuf();
  both.close();
  options_.client_ca = folder_.Path() / "both.pem";
  EXPECT_EQ(Fault(), "");
}

TEST_F(LoadTlsTest, EmptyWriteRolesAskForNone) {
  EXPECT_TRUE(LoadTls(options_)->RoleMayWrite(""));
  options_.write_roles = {"Operator", "Engineer"};
  const auto tls = LoadTls(options_);
  EXPECT_FALSE(tls->RoleMayWrite(""));
  EXPECT_FALSE(tls->RoleMayWrite("Viewer"));
  EXPECT_TRUE(tls->RoleMayWrite("Engineer"));
}

class RoleOfTest : public ::testing::Test {
 protected:
  std::string RoleOfOne(const test::IssueOptions& options) { return RoleOf(*ca_.Sign("client", key_.get(), options)); }

  test::TemporaryFolder folder_;
  test::Authority ca_{folder_.Path(), "ca"};
  test::Key key_ = test::MakeKey();
};

TEST_F(RoleOfTest, IsTheTextOfTheExtension) { EXPECT_EQ(RoleOfOne({.role = "Operator"}), "Operator"); }

TEST_F(RoleOfTest, TakesThePlainStringsOfAsn1Too) {
  EXPECT_EQ(RoleOfOne({.role = "Operator", .role_type = V_ASN1_PRINTABLESTRING}), "Operator");
  EXPECT_EQ(RoleOfOne({.role = "Operator", .role_type = V_ASN1_IA5STRING}), "Operator");
}

TEST_F(RoleOfTest, IsEmptyWithoutTheExtension) { EXPECT_EQ(RoleOfOne({}), ""); }

TEST_F(RoleOfTest, IsEmptyWhenItIsNoString) {
  EXPECT_EQ(RoleOfOne({.role = "Operator", .role_type = V_ASN1_OCTET_STRING}), "");
}

TEST_F(RoleOfTest, IsEmptyWhenThereAreSeveral) { EXPECT_EQ(RoleOfOne({.role = "Operator", .roles = 2}), ""); }

TEST(TlsSession, RubbishBreaksItWithAReason) {
  const test::TemporaryFolder folder;
  test::Authority ca(folder.Path(), "ca");
  const test::Issued server = ca.Issue("server");
  ModbusTlsOptions options;
  options.certificate = server.certificate;
  options.key = server.key;
  options.client_ca = ca.File();
  const TlsContext context(options);
  TlsSession session(context);
  std::vector<std::uint8_t> plain;
  const std::vector<std::uint8_t> modbus{0, 9, 0, 0, 0, 6, 3, 3, 0, 5, 0, 1};
  EXPECT_FALSE(session.Take(modbus, plain));
  EXPECT_EQ(session.Fault(), "wrong version number");
  EXPECT_FALSE(session.Take(modbus, plain));
  EXPECT_TRUE(plain.empty());
}

}  // namespace
}  // namespace granary
