// A TLS client for the loopback tests, with OpenSSL's own sockets: nothing of the server's code is used.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include <openssl/ssl.h>

#include "tests/daemon/modbus/certificates.h"
#include "tests/daemon/modbus/client.h"

namespace granary::test {

struct TlsClientOptions {
  std::optional<Issued> own;  ///< empty: shows no certificate
  int version = TLS1_3_VERSION;
};

class TlsClient {
 public:
  /// Connects; shakes hands with the first Ask. @param server_ca who signed the server's certificate
  TlsClient(std::uint16_t port, const std::filesystem::path& server_ca, const TlsClientOptions& options);

  /// Sends a frame, or nothing. @return `size` bytes of the answer, fewer when the server closes or refuses the handshake
  Bytes Ask(const Bytes& frame, std::size_t size);
  /// Says that nothing follows. @return whether the server says so, too
  bool SayGoodbye();
  [[nodiscard]] bool WasResumable() const;  ///< the server gave a ticket
  [[nodiscard]] RawClient& Raw() { return raw_; }
  [[nodiscard]] SSL* Session() { return session_.get(); }

 private:
  struct Free {
    void operator()(SSL_CTX* context) const { SSL_CTX_free(context); }
    void operator()(SSL* session) const { SSL_free(session); }
  };
  RawClient raw_;
  std::unique_ptr<SSL_CTX, Free> context_;
  std::unique_ptr<SSL, Free> session_;
};

}  // namespace granary::test
