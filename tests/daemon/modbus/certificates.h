// Certificates for the TLS tests, made as they are needed: an authority, a server, clients with and without a role.
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include <openssl/evp.h>
#include <openssl/x509.h>

namespace granary::test {

/// A folder of its own that goes with the value.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& Path() const { return path_; }

 private:
  std::filesystem::path path_;
};

struct FreeCertificate {
  void operator()(X509* certificate) const { X509_free(certificate); }
  void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
};
using Certificate = std::unique_ptr<X509, FreeCertificate>;
using Key = std::unique_ptr<EVP_PKEY, FreeCertificate>;

/// Two PEM files.
struct Issued {
  std::filesystem::path certificate, key;
};

struct IssueOptions {
  std::optional<std::string> role = std::nullopt;
  int role_type = V_ASN1_UTF8STRING;
  int roles = 1;                                              ///< how often the role is there
  std::chrono::seconds valid_from{-3600}, valid_until{3600};  ///< from now
};

class Authority {
 public:
  /// Writes NAME.pem into `folder`.
  Authority(const std::filesystem::path& folder, const std::string& name);
  /// Writes NAME.pem and NAME.key beside it.
  Issued Issue(const std::string& name, const IssueOptions& options = {});
  /// The same in memory.
  [[nodiscard]] Certificate Sign(const std::string& name, EVP_PKEY* key, const IssueOptions& options = {});
  [[nodiscard]] const std::filesystem::path& File() const { return file_; }

 private:
  std::filesystem::path folder_, file_;
  Key key_;
  Certificate certificate_;
  long serial_ = 1;
};

/// A fresh key on the curve P-256.
[[nodiscard]] Key MakeKey();
/// @param passphrase empty leaves it in the clear
void WriteKey(EVP_PKEY* key, const std::filesystem::path& file, const std::string& passphrase = {});

}  // namespace granary::test
