// One client of the Modbus server: its socket, what it has sent and what it has yet to take.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "daemon/modbus/framing.h"
#include "daemon/modbus/socket.h"
#include "daemon/modbus/tls.h"

namespace granary {

using SteadyTime = std::chrono::steady_clock::time_point;

/// How long a client may keep the server waiting.
struct ModbusLimits {
  std::chrono::milliseconds frame_deadline{2000};      ///< from a frame's first byte to its last
  std::chrono::milliseconds handshake_deadline{5000};  ///< TLS: from the connect to the last word of the handshake
  std::chrono::milliseconds idle_timeout{60000};       ///< without a complete request
  std::chrono::milliseconds stall_deadline{10000};     ///< with answers that the client does not take
  std::size_t max_unsent_bytes = 64 * 1024;            ///< above this no further request is read
};

/// Never blocks. Not thread-safe: it belongs to the server's thread. Plain and TLS clients differ in nothing but what
/// goes over the wire.
class Connection {
 public:
  /// @param socket connected and non-blocking
  /// @param tls empty for a plain client
  Connection(FileDescriptor socket, std::string peer, SteadyTime now, std::optional<TlsSession> tls = std::nullopt);

  /// Takes what has arrived, up to one chunk. @return false when the connection is broken
  [[nodiscard]] bool Receive(SteadyTime now);
  /// The frame that the received bytes begin with; valid until Answer or Receive.
  [[nodiscard]] ModbusFrame Next() const { return ParseFrame(std::span(received_).subspan(taken_)); }
  /// Drops a frame from the received bytes, answered with `pdu`.
  void Answer(const ModbusFrame& frame, std::span<const std::uint8_t> pdu, SteadyTime now);
  /// Sends what the socket takes. @return false when the connection is broken
  [[nodiscard]] bool Send(SteadyTime now);
  /// Starts or ends the deadline of an unfinished frame; to be called once all complete frames are answered.
  void WatchFrame(SteadyTime now);
  /// Tells a TLS client that this was all; as far as the socket takes it.
  void SayGoodbye(SteadyTime now);

  /// When it must be closed unless something happens.
  [[nodiscard]] SteadyTime Deadline(const ModbusLimits& limits) const;
  [[nodiscard]] std::size_t UnsentBytes() const { return answers_.size() + unsent_.size() - sent_; }
  [[nodiscard]] bool Ended() const { return ended_ || (tls_ && tls_->Ended()); }  ///< the client sends no more
  [[nodiscard]] bool HasAsked() const { return first_asked_.has_value(); }        ///< it has sent a complete request
  [[nodiscard]] std::optional<SteadyTime> FirstAsked() const { return first_asked_; }
  [[nodiscard]] SteadyTime LastActive() const {
    return last_active_;
  }  ///< newest complete request; before it the connect or handshake
  [[nodiscard]] const std::string& Peer() const { return peer_; }
  [[nodiscard]] int Socket() const { return socket_.Get(); }

  [[nodiscard]] bool InHandshake() const { return tls_ && !tls_->Secure(); }
  /// What was wrong with its TLS or its certificate; empty when nothing was.
  [[nodiscard]] std::string TlsFault() const { return tls_ ? tls_->Fault() : std::string(); }
  /// Whether the role in its certificate may write; a plain client needs none.
  [[nodiscard]] bool RoleMayWrite() const { return !tls_ || tls_->RoleMayWrite(); }

 private:
  FileDescriptor socket_;
  std::string peer_;
  std::optional<TlsSession> tls_;
  std::vector<std::uint8_t> received_;  ///< in the clear
  std::size_t taken_ = 0;               ///< bytes of received_ that are answered
  std::vector<std::uint8_t> answers_;   ///< TLS: in the clear, until Send
  std::vector<std::uint8_t> unsent_;    ///< as they go over the wire
  std::size_t sent_ = 0;                ///< bytes of unsent_ that the socket has taken
  SteadyTime last_active_;
  SteadyTime last_sent_;                   ///< newest progress of `unsent_`
  std::optional<SteadyTime> first_asked_;  ///< first complete request
  std::optional<SteadyTime> frame_since_;  ///< first byte of an unfinished frame
  bool ended_ = false;
};

}  // namespace granary
