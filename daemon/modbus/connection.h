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

namespace granary {

using SteadyTime = std::chrono::steady_clock::time_point;

/// How long a client may keep the server waiting.
struct ModbusLimits {
  std::chrono::milliseconds frame_deadline{2000};   ///< from a frame's first byte to its last
  std::chrono::milliseconds idle_timeout{60000};    ///< without a complete request
  std::chrono::milliseconds stall_deadline{10000};  ///< with answers that the client does not take
  std::size_t max_unsent_bytes = 64 * 1024;         ///< above this no further request is read
};

/// Never blocks. Not thread-safe: it belongs to the server's thread.
class Connection {
 public:
  /// Switches keepalive on, so that a peer that vanished is known within a minute.
  /// @param socket connected and non-blocking @throws std::system_error
  Connection(FileDescriptor socket, std::string peer, SteadyTime now);

  /// Takes what has arrived, up to one chunk. @return false when the connection is broken
  [[nodiscard]] bool Receive();
  /// The frame that the received bytes begin with; valid until Consume or Receive.
  [[nodiscard]] ModbusFrame Next() const { return ParseFrame(received_); }
  /// Drops a frame from the received bytes, answered with `pdu`.
  void Answer(const ModbusFrame& frame, std::span<const std::uint8_t> pdu, SteadyTime now);
  /// Sends what the socket takes. @return false when the connection is broken
  [[nodiscard]] bool Send(SteadyTime now);
  /// Starts or ends the deadline of an unfinished frame; to be called once all complete frames are answered.
  void WatchFrame(SteadyTime now);

  /// When it must be closed unless something happens.
  [[nodiscard]] SteadyTime Deadline(const ModbusLimits& limits) const;
  [[nodiscard]] std::size_t UnsentBytes() const { return unsent_.size(); }
  [[nodiscard]] bool Ended() const { return ended_; }         ///< the client sends no more
  [[nodiscard]] bool HasAsked() const { return has_asked_; }  ///< it has sent a complete request
  [[nodiscard]] SteadyTime LastActive() const { return last_active_; }
  [[nodiscard]] const std::string& Peer() const { return peer_; }
  [[nodiscard]] int Socket() const { return socket_.Get(); }

 private:
  FileDescriptor socket_;
  std::string peer_;
  std::vector<std::uint8_t> received_, unsent_;
  SteadyTime last_active_;                 ///< newest complete request, or the connect
  SteadyTime last_sent_;                   ///< newest progress of `unsent_`
  std::optional<SteadyTime> frame_since_;  ///< first byte of an unfinished frame
  bool has_asked_ = false;
  bool ended_ = false;
};

}  // namespace granary
