// Short keys on a curve, so that a test costs milliseconds.
#include "tests/daemon/modbus/certificates.h"

#include <cstdio>
#include <cstdlib>
#include <stdexcept>

#include <openssl/asn1.h>
#include <openssl/ec.h>
#include <openssl/objects.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

namespace granary::test {
namespace {

void Require(bool done, const char* what) {
  if (!done) throw std::runtime_error(std::string("certificates: ") + what);
}

using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

File Create(const std::filesystem::path& path) {
  File file(std::fopen(path.c_str(), "w"), &std::fclose);
  Require(file != nullptr, "fopen");
  return file;
}

void WriteCertificate(X509* certificate, const std::filesystem::path& path) {
  Require(PEM_write_X509(Create(path).get(), certificate) == 1, "PEM_write_X509");
}

void AddRole(X509* certificate, const std::string& role, int type) {
  ASN1_OBJECT* const oid = OBJ_txt2obj("1.3.6.1.4.1.50316.802.1", 1);
  ASN1_STRING* const text = ASN1_STRING_type_new(type);
  ASN1_STRING_set(text, role.data(), static_cast<int>(role.size()));
  ASN1_TYPE* const value = ASN1_TYPE_new();
  ASN1_TYPE_set(value, type, text);  // takes text
  unsigned char* der = nullptr;
  const int size = i2d_ASN1_TYPE(value, &der);
  Require(size > 0, "i2d_ASN1_TYPE");
  ASN1_OCTET_STRING* const data = ASN1_OCTET_STRING_new();
  ASN1_OCTET_STRING_set(data, der, size);
  X509_EXTENSION* const extension = X509_EXTENSION_create_by_OBJ(nullptr, oid, 0, data);
  Require(X509_add_ext(certificate, extension, -1) == 1, "X509_add_ext");
  X509_EXTENSION_free(extension);
  ASN1_OCTET_STRING_free(data);
  OPENSSL_free(der);
  ASN1_TYPE_free(value);
  ASN1_OBJECT_free(oid);
}

void AddBasicConstraints(X509* certificate) {
  X509_EXTENSION* const extension = X509V3_EXT_conf_nid(nullptr, nullptr, NID_basic_constraints, "critical,CA:TRUE");
  Require(extension != nullptr && X509_add_ext(certificate, extension, -1) == 1, "CA:TRUE");
  X509_EXTENSION_free(extension);
}

Certificate Make(const std::string& name, EVP_PKEY* key, long serial, const IssueOptions& options) {
  Certificate certificate(X509_new());
  X509_set_version(certificate.get(), X509_VERSION_3);
  ASN1_INTEGER_set(X509_get_serialNumber(certificate.get()), serial);
  X509_gmtime_adj(X509_getm_notBefore(certificate.get()), options.valid_from.count());
  X509_gmtime_adj(X509_getm_notAfter(certificate.get()), options.valid_until.count());
  X509_NAME* const subject = X509_get_subject_name(certificate.get());
  X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_UTF8, reinterpret_cast<const unsigned char*>(name.c_str()), -1, -1,
                             0);
  X509_set_pubkey(certificate.get(), key);
  return certificate;
}

}  // namespace

TemporaryFolder::TemporaryFolder() {
  std::string name = (std::filesystem::temp_directory_path() / "granary-tls-XXXXXX").string();
  Require(mkdtemp(name.data()) != nullptr, "mkdtemp");
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;  // a folder left in /tmp is no reason to fail
  std::filesystem::remove_all(path_, ignored);
}

Key MakeKey() {
  Key key(EVP_EC_gen("P-256"));
  Require(key != nullptr, "EVP_EC_gen");
  return key;
}

void WriteKey(EVP_PKEY* key, const std::filesystem::path& file, const std::string& passphrase) {
  const File opened = Create(file);
  const EVP_CIPHER* const cipher = passphrase.empty() ? nullptr : EVP_aes_256_cbc();
  const int written =
      PEM_write_PKCS8PrivateKey(opened.get(), key, cipher, passphrase.empty() ? nullptr : passphrase.data(),
                                static_cast<int>(passphrase.size()), nullptr, nullptr);
  Require(written == 1, "PEM_write_PKCS8PrivateKey");
}

Authority::Authority(const std::filesystem::path& folder, const std::string& name)
    : folder_(folder), file_(folder / (name + ".pem")), key_(MakeKey()), certificate_(Make(name, key_.get(), 1, {})) {
  X509_set_issuer_name(certificate_.get(), X509_get_subject_name(certificate_.get()));
  AddBasicConstraints(certificate_.get());
  Require(X509_sign(certificate_.get(), key_.get(), EVP_sha256()) > 0, "X509_sign");
  WriteCertificate(certificate_.get(), file_);
}

Certificate Authority::Sign(const std::string& name, EVP_PKEY* key, const IssueOptions& options) {
  Certificate certificate = Make(name, key, ++serial_, options);
  X509_set_issuer_name(certificate.get(), X509_get_subject_name(certificate_.get()));
  for (int i = 0; options.role && i < options.roles; ++i) AddRole(certificate.get(), *options.role, options.role_type);
  Require(X509_sign(certificate.get(), key_.get(), EVP_sha256()) > 0, "X509_sign");
  return certificate;
}

Issued Authority::Issue(const std::string& name, const IssueOptions& options) {
  const Key key = MakeKey();
  const Issued issued{folder_ / (name + ".pem"), folder_ / (name + ".key")};
  WriteCertificate(Sign(name, key.get(), options).get(), issued.certificate);
  WriteKey(key.get(), issued.key);
  return issued;
}

}  // namespace granary::test
