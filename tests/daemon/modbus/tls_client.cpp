// A receive timeout on the socket is all that guards against a server that neither answers nor closes.
#include "tests/daemon/modbus/tls_client.h"

#include <stdexcept>

#include <openssl/err.h>
#include <sys/socket.h>
#include <sys/time.h>

namespace granary::test {

TlsClient::TlsClient(std::uint16_t port, const std::filesystem::path& server_ca, const TlsClientOptions& options)
    : raw_(port), context_(SSL_CTX_new(TLS_client_method())) {
  SSL_CTX* const context = context_.get();
  bool good = SSL_CTX_set_min_proto_version(context, options.version) == 1;
  good = good && SSL_CTX_set_max_proto_version(context, options.version) == 1;
  good = good && SSL_CTX_load_verify_locations(context, server_ca.c_str(), nullptr) == 1;
  SSL_CTX_set_verify(context, SSL_VERIFY_PEER, nullptr);
  if (options.own) {
    good = good && SSL_CTX_use_certificate_chain_file(context, options.own->certificate.c_str()) == 1;
    good = good && SSL_CTX_use_PrivateKey_file(context, options.own->key.c_str(), SSL_FILETYPE_PEM) == 1;
  }
  session_.reset(SSL_new(context));
  good = good && session_ && SSL_set_fd(session_.get(), raw_.Socket()) == 1;
  const timeval guard{kGuardMs / 1000, 0};
  good = good && setsockopt(raw_.Socket(), SOL_SOCKET, SO_RCVTIMEO, &guard, sizeof guard) == 0;
  if (!good) throw std::runtime_error("the TLS client of the test cannot be set up");
  SSL_set_connect_state(session_.get());
}

Bytes TlsClient::Ask(const Bytes& frame, std::size_t size) {
  ERR_clear_error();
  Bytes answer;
  const auto bytes = static_cast<int>(frame.size());
  if (bytes > 0 && SSL_write(session_.get(), frame.data(), bytes) <= 0) return answer;
  while (answer.size() < size) {
    Bytes chunk(size - answer.size());
    const int got = SSL_read(session_.get(), chunk.data(), static_cast<int>(chunk.size()));
    if (got <= 0) break;
    answer.insert(answer.end(), chunk.begin(), chunk.begin() + got);
  }
  return answer;
}

bool TlsClient::SayGoodbye() {
  ERR_clear_error();
  SSL_shutdown(session_.get());
  return SSL_shutdown(session_.get()) == 1;
}

bool TlsClient::WasResumable() const { return SSL_SESSION_is_resumable(SSL_get0_session(session_.get())) == 1; }

}  // namespace granary::test
