// Bytes in, bytes out, and the clocks that run meanwhile. A deadline counts from a frame's first byte, so that a drip
// of single bytes cannot extend it.
#include "daemon/modbus/connection.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <utility>

#include <sys/socket.h>

namespace granary {
namespace {

constexpr std::size_t kChunkBytes = 4096;

bool IsForLater(int error) { return error == EAGAIN || error == EWOULDBLOCK || error == EINTR; }

void DropFront(std::vector<std::uint8_t>& bytes, std::size_t& count) {
  bytes.erase(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(count));
  count = 0;
}

}  // namespace

Connection::Connection(FileDescriptor socket, std::string peer, SteadyTime now, std::optional<TlsSession> tls)
    : socket_(std::move(socket)), peer_(std::move(peer)), tls_(std::move(tls)), last_active_(now), last_sent_(now) {}

bool Connection::Receive(SteadyTime now) {
  std::array<std::uint8_t, kChunkBytes> chunk;
  const ssize_t got = recv(socket_.Get(), chunk.data(), chunk.size(), 0);
  if (got < 0) return IsForLater(errno);
  if (got == 0) ended_ = true;
  DropFront(received_, taken_);
  const auto wire = std::span(chunk).first(static_cast<std::size_t>(got));
  if (!tls_) {
    received_.insert(received_.end(), wire.begin(), wire.end());
    return true;
  }
  const bool was_in_handshake = InHandshake();
  const bool sound = tls_->Take(wire, received_);
  tls_->MoveWire(unsent_);
  if (was_in_handshake && tls_->Secure()) {
    peer_.append(" (").append(tls_->Client()).append(")");
    last_active_ = now;
  }
  return sound;
}

void Connection::Answer(const ModbusFrame& frame, std::span<const std::uint8_t> pdu, SteadyTime now) {
  if (UnsentBytes() == 0) last_sent_ = now;
  AppendFrame(frame.transaction, frame.unit, pdu, tls_ ? answers_ : unsent_);
  taken_ += frame.bytes;
  frame_since_.reset();
  last_active_ = now;
  if (!first_asked_) first_asked_ = now;
}

bool Connection::Send(SteadyTime now) {
  if (!answers_.empty()) {
    if (!tls_->Give(answers_)) return false;
    answers_.clear();
    tls_->MoveWire(unsent_);
  }
  if (unsent_.empty()) return true;
  const ssize_t sent = send(socket_.Get(), unsent_.data() + sent_, unsent_.size() - sent_, MSG_NOSIGNAL);
  if (sent < 0) return IsForLater(errno);
  if (sent > 0) last_sent_ = now;
  sent_ += static_cast<std::size_t>(sent);
  // Not after every send: what is left would be moved over and over for a client that takes little at a time.
  if (2 * sent_ >= unsent_.size()) DropFront(unsent_, sent_);
  return true;
}

void Connection::WatchFrame(SteadyTime now) {
  if (received_.size() == taken_) {
    frame_since_.reset();
  } else if (!frame_since_) {
    frame_since_ = now;
  }
}

void Connection::SayGoodbye(SteadyTime now) {
  if (!tls_ || !tls_->Secure()) return;
  tls_->End();
  tls_->MoveWire(unsent_);
  static_cast<void>(Send(now));  // it is closed next, whether it hears this or not
}

SteadyTime Connection::Deadline(const ModbusLimits& limits) const {
  SteadyTime deadline = last_active_ + (InHandshake() ? limits.handshake_deadline : limits.idle_timeout);
  if (frame_since_) deadline = std::min(deadline, *frame_since_ + limits.frame_deadline);
  // A request may wait with nothing unsent: the socket took the answers before it, but has no room for more.
  const bool owed = UnsentBytes() > 0 || Next().state == FrameState::kComplete;
  if (owed) deadline = std::min(deadline, last_sent_ + limits.stall_deadline);
  return deadline;
}

}  // namespace granary
