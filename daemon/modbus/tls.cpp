// OpenSSL between two buffers in memory: the server's sockets stay its own, so a TLS client is one more source of bytes
// in the same loop, with the same deadlines. Sessions are never resumed: no tickets, no early data, nothing to replay.
#include "daemon/modbus/tls.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <filesystem>
#include <stdexcept>
#include <string_view>
#include <system_error>

#include <fcntl.h>
#include <openssl/asn1.h>
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/objects.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include "daemon/modbus/socket.h"

namespace granary {
namespace {

constexpr const char* kRoleOid = "1.3.6.1.4.1.50316.802.1";  // Source: MB-TCP-Security-v21, §8.4

struct FreeOpenSsl {
  void operator()(BIO* bio) const { BIO_free(bio); }
  void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
  void operator()(ASN1_TYPE* type) const { ASN1_TYPE_free(type); }
  void operator()(ASN1_OBJECT* object) const { ASN1_OBJECT_free(object); }
};
template <typename T>
using Owned = std::unique_ptr<T, FreeOpenSsl>;

/// What OpenSSL's queue of errors says, oldest first, which is nearest to the cause; empties it.
std::string Words() {
  std::string words;
  while (const unsigned long error = ERR_get_error()) {
    const char* reason = ERR_reason_error_string(error);
    std::array<char, 256> whole{};
    if (reason == nullptr) ERR_error_string_n(error, whole.data(), whole.size());
    const std::string_view next = reason == nullptr ? whole.data() : reason;
    if (words.ends_with(next)) continue;
    words.append(words.empty() ? "" : ", ").append(next);
  }
  return words.empty() ? "OpenSSL gives no reason" : words;
}

std::runtime_error FileFault(const char* key, const std::filesystem::path& file, const std::string& cause) {
  return std::runtime_error("modbus.tls." + std::string(key) + ": " + file.string() + ": " + cause);
}

/// OpenSSL's own words for a file that cannot be opened name neither file nor cause.
void RequireReadable(const char* key, const std::filesystem::path& file) {
  const FileDescriptor opened(open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (opened.Get() < 0) throw FileFault(key, file, std::generic_category().message(errno));
}

std::string TextOf(BIO* bio) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(bio, &data);
  return size > 0 ? std::string(data, static_cast<std::size_t>(size)) : std::string();
}

std::string TextOf(const ASN1_TIME* time) {
  const Owned<BIO> text(BIO_new(BIO_s_mem()));
  return text && ASN1_TIME_print(text.get(), time) == 1 ? TextOf(text.get()) : "unknown";
}

void RequireCurrent(const std::filesystem::path& file, const X509* certificate) {
  if (X509_cmp_current_time(X509_get0_notAfter(certificate)) < 0) {
    throw FileFault("certificate", file, "expired at " + TextOf(X509_get0_notAfter(certificate)));
  }
  if (X509_cmp_current_time(X509_get0_notBefore(certificate)) > 0) {
    throw FileFault("certificate", file, "is not valid before " + TextOf(X509_get0_notBefore(certificate)));
  }
}

/// A daemon has nobody to ask: without this OpenSSL would wait at the terminal.
int NoPassphrase(char*, int, int, void* asked) {
  *static_cast<bool*>(asked) = true;
  return 0;
}

Owned<EVP_PKEY> ReadKey(const std::filesystem::path& file) {
  RequireReadable("key", file);
  bool asked = false;
  const Owned<BIO> pem(BIO_new_file(file.c_str(), "r"));
  Owned<EVP_PKEY> key(pem ? PEM_read_bio_PrivateKey(pem.get(), nullptr, NoPassphrase, &asked) : nullptr);
  if (key) return key;
  const std::string words = Words();
  throw FileFault("key", file,
                  asked ? "needs a passphrase, for which a daemon cannot ask: " + words : "is no key in PEM: " + words);
}

}  // namespace

TlsContext::TlsContext(const ModbusTlsOptions& options)
    : context_(SSL_CTX_new(TLS_server_method())), write_roles_(options.write_roles) {
  ERR_clear_error();
  SSL_CTX* const context = context_.get();
  if (context == nullptr) throw std::runtime_error("modbus.tls: SSL_CTX_new: " + Words());
  if (SSL_CTX_set_min_proto_version(context, TLS1_3_VERSION) != 1 ||
      SSL_CTX_set_max_proto_version(context, TLS1_3_VERSION) != 1) {
    throw std::runtime_error("modbus.tls: this OpenSSL has no TLS 1.3: " + Words());
  }
  SSL_CTX_set_options(context, SSL_OP_NO_TICKET);
  SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
  if (SSL_CTX_set_num_tickets(context, 0) != 1 || SSL_CTX_set_max_early_data(context, 0) != 1) {
    throw std::runtime_error("modbus.tls: cannot switch resumption off: " + Words());
  }
  SSL_CTX_set_mode(context, SSL_MODE_RELEASE_BUFFERS);  // idle clients hold no 32 kB each

  RequireReadable("certificate", options.certificate);
  if (SSL_CTX_use_certificate_chain_file(context, options.certificate.c_str()) != 1) {
    throw FileFault("certificate", options.certificate, "is no certificate in PEM: " + Words());
  }
  RequireCurrent(options.certificate, SSL_CTX_get0_certificate(context));
  if (SSL_CTX_use_PrivateKey(context, ReadKey(options.key).get()) != 1) {
    throw FileFault("key", options.key, "does not belong to " + options.certificate.string() + ": " + Words());
  }
  RequireReadable("client_ca", options.client_ca);
  STACK_OF(X509_NAME)* const names = SSL_load_client_CA_file(options.client_ca.c_str());
  if (names == nullptr || SSL_CTX_load_verify_locations(context, options.client_ca.c_str(), nullptr) != 1) {
    sk_X509_NAME_pop_free(names, X509_NAME_free);
    throw FileFault("client_ca", options.client_ca, "is no certificate in PEM: " + Words());
  }
  SSL_CTX_set_client_CA_list(context, names);  // takes them
  SSL_CTX_set_verify(context, SSL_VERIFY_PEER | SSL_VERIFY_FAIL_IF_NO_PEER_CERT, nullptr);
}

bool TlsContext::RoleMayWrite(const std::string& role) const {
  return write_roles_.empty() || std::find(write_roles_.begin(), write_roles_.end(), role) != write_roles_.end();
}

std::shared_ptr<const TlsContext> LoadTls(const ModbusTlsOptions& options) {
  return std::make_shared<const TlsContext>(options);
}

TlsSession::TlsSession(const TlsContext& context) : context_(&context), session_(SSL_new(context.Get())) {
  ERR_clear_error();
  Owned<BIO> in(BIO_new(BIO_s_mem())), out(BIO_new(BIO_s_mem()));
  if (!session_ || !in || !out) throw std::runtime_error("TLS: " + Words());
  from_wire_ = in.release();
  to_wire_ = out.release();
  SSL_set_bio(session_.get(), from_wire_, to_wire_);  // takes both
  SSL_set_accept_state(session_.get());
}

bool TlsSession::Take(std::span<const std::uint8_t> wire, std::vector<std::uint8_t>& plain) {
  if (!fault_.empty()) return false;
  ERR_clear_error();
  if (!wire.empty()) {
    const int written = BIO_write(from_wire_, wire.data(), static_cast<int>(wire.size()));
    if (written != static_cast<int>(wire.size())) return Broken(-1);
  }
  if (!secure_) {
    if (const int result = SSL_do_handshake(session_.get()); result != 1) return !Broken(result);
    MeetClient();
  }
  std::array<std::uint8_t, 4096> chunk;
  while (true) {
    std::size_t got = 0;
    if (const int result = SSL_read_ex(session_.get(), chunk.data(), chunk.size(), &got); result != 1) {
      return !Broken(result);
    }
    plain.insert(plain.end(), chunk.begin(), chunk.begin() + static_cast<std::ptrdiff_t>(got));
  }
}

bool TlsSession::Give(std::span<const std::uint8_t> plain) {
  if (!fault_.empty() || plain.empty()) return fault_.empty();
  ERR_clear_error();
  std::size_t written = 0;  // all of it: a buffer in memory is never full
  const int result = SSL_write_ex(session_.get(), plain.data(), plain.size(), &written);
  return result == 1 || !Broken(result);
}

void TlsSession::MoveWire(std::vector<std::uint8_t>& wire) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(to_wire_, &data);
  if (size <= 0) return;
  wire.insert(wire.end(), data, data + size);
  static_cast<void>(BIO_reset(to_wire_));  // of a buffer in memory: cannot fail
}

void TlsSession::End() {
  if (!secure_ || !fault_.empty()) return;
  ERR_clear_error();
  if (SSL_shutdown(session_.get()) < 0) static_cast<void>(Broken(-1));
}

/// After a call that did not succeed: whether the session is over, and not just short of bytes.
bool TlsSession::Broken(int result) {
  switch (SSL_get_error(session_.get(), result)) {
    case SSL_ERROR_WANT_READ:
      return false;
    case SSL_ERROR_ZERO_RETURN:
      ended_ = true;
      return false;
    default:
      break;
  }
  const long verdict = SSL_get_verify_result(session_.get());
  fault_ = verdict == X509_V_OK ? Words() : std::string("certificate: ") + X509_verify_cert_error_string(verdict);
  ERR_clear_error();
  return true;
}

void TlsSession::MeetClient() {
  const X509* const certificate = SSL_get0_peer_certificate(session_.get());
  if (certificate == nullptr) throw std::logic_error("TLS: a handshake without a certificate went through");
  const std::string role = RoleOf(*certificate);
  role_may_write_ = context_->RoleMayWrite(role);
  // Escaped by OpenSSL: a name with a line break must not write a log line of its own.
  const Owned<BIO> name(BIO_new(BIO_s_mem()));
  if (name && X509_NAME_print_ex(name.get(), X509_get_subject_name(certificate), 0,
                                 XN_FLAG_ONELINE & ~ASN1_STRFLGS_ESC_MSB) >= 0) {
    client_ = TextOf(name.get());
  }
  secure_ = true;
}

std::string RoleOf(const X509& certificate) {
  const Owned<ASN1_OBJECT> oid(OBJ_txt2obj(kRoleOid, 1));
  if (!oid) throw std::runtime_error("TLS: OBJ_txt2obj: " + Words());
  const int index = X509_get_ext_by_OBJ(&certificate, oid.get(), -1);
  if (index < 0 || X509_get_ext_by_OBJ(&certificate, oid.get(), index) >= 0) return {};
  const ASN1_OCTET_STRING* const data = X509_EXTENSION_get_data(X509_get_ext(&certificate, index));
  const unsigned char* next = ASN1_STRING_get0_data(data);
  const unsigned char* const end = next + ASN1_STRING_length(data);
  const Owned<ASN1_TYPE> value(d2i_ASN1_TYPE(nullptr, &next, ASN1_STRING_length(data)));
  ERR_clear_error();
  if (!value || next != end) return {};
  const int type = ASN1_TYPE_get(value.get());
  if (type != V_ASN1_UTF8STRING && type != V_ASN1_PRINTABLESTRING && type != V_ASN1_IA5STRING) return {};
  const ASN1_STRING* const text = value->value.asn1_string;
  return {reinterpret_cast<const char*>(ASN1_STRING_get0_data(text)),
          static_cast<std::size_t>(ASN1_STRING_length(text))};
}

}  // namespace granary
