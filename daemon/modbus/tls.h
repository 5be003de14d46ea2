// Modbus/TCP Security (MB-TCP-Security-v21): TLS 1.3, both sides show certificates, the client's names its role.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <openssl/ssl.h>

#include "daemon/options.h"

namespace granary {

/// Our certificate and key, whose clients we trust, and which roles may write. Never changes: any thread.
class TlsContext {
 public:
  /// @throws std::runtime_error that names key, file and OpenSSL's words
  explicit TlsContext(const ModbusTlsOptions& options);

  [[nodiscard]] SSL_CTX* Get() const { return context_.get(); }
  /// @param role empty when the certificate has none
  [[nodiscard]] bool RoleMayWrite(const std::string& role) const;

 private:
  struct Free {
    void operator()(SSL_CTX* context) const { SSL_CTX_free(context); }
  };
  std::unique_ptr<SSL_CTX, Free> context_;
  std::vector<std::string> write_roles_;
};

/// Reads certificates and key anew. @throws std::runtime_error that names key, file and OpenSSL's words
[[nodiscard]] std::shared_ptr<const TlsContext> LoadTls(const ModbusTlsOptions& options);

/// One client's TLS, from its first word to its last: bytes of the wire become plain ones and back. It knows no socket
/// and never blocks. Not thread-safe.
class TlsSession {
 public:
  /// @param context borrowed
  /// @throws std::runtime_error with OpenSSL's words
  explicit TlsSession(const TlsContext& context);

  /// Takes bytes of the wire, shakes hands while that is due, appends what they say to `plain`.
  /// @return false when the session is broken; Fault() says why
  [[nodiscard]] bool Take(std::span<const std::uint8_t> wire, std::vector<std::uint8_t>& plain);
  /// Encrypts what is to be sent. @return false when the session is broken
  [[nodiscard]] bool Give(std::span<const std::uint8_t> plain);
  /// Appends to `wire` what is to be sent, alerts and handshake included.
  void MoveWire(std::vector<std::uint8_t>& wire);
  /// Says that nothing follows.
  void End();

  [[nodiscard]] bool Secure() const { return secure_; }  ///< the handshake is done and the certificate is good
  [[nodiscard]] bool Ended() const { return ended_; }    ///< the client has said that nothing follows
  [[nodiscard]] bool RoleMayWrite() const { return role_may_write_; }
  [[nodiscard]] const std::string& Client() const { return client_; }  ///< subject and role, for logs; once secure
  [[nodiscard]] const std::string& Fault() const { return fault_; }    ///< why it is broken; empty while it is not

 private:
  void MeetClient();
  [[nodiscard]] bool Broken(int result);

  struct Free {
    void operator()(SSL* session) const { SSL_free(session); }
  };
  const TlsContext* context_;
  std::unique_ptr<SSL, Free> session_;
  BIO* from_wire_ = nullptr;  ///< owned by session_
  BIO* to_wire_ = nullptr;    ///< owned by session_
  std::string client_, fault_;
  bool secure_ = false, ended_ = false, role_may_write_ = false;
};

/// The role in a certificate, an ASN.1 string under OID 1.3.6.1.4.1.50316.802.1; empty when there is none, when it is
/// no string, or when there are several.
[[nodiscard]] std::string RoleOf(const X509& certificate);

}  // namespace granary
