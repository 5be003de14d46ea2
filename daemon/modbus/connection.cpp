// Bytes in, bytes out, and the clocks that run meanwhile. A deadline counts from a frame's first byte, so that a drip
// of single bytes cannot extend it.
#include "daemon/modbus/connection.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <system_error>

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

namespace granary {
namespace {

constexpr std::size_t kChunkBytes = 4096;

void SetOption(int socket, int level, int option, int value, const char* name) {
  if (setsockopt(socket, level, option, &value, sizeof value) != 0) {
    throw std::system_error(errno, std::generic_category(), std::string("setsockopt ") + name);
  }
}

bool IsForLater(int error) { return error == EAGAIN || error == EWOULDBLOCK || error == EINTR; }

}  // namespace

Connection::Connection(FileDescriptor socket, std::string peer, SteadyTime now)
    : socket_(std::move(socket)), peer_(std::move(peer)), last_active_(now), last_sent_(now) {
  SetOption(socket_.Get(), SOL_SOCKET, SO_KEEPALIVE, 1, "SO_KEEPALIVE");
  SetOption(socket_.Get(), IPPROTO_TCP, TCP_KEEPIDLE, 20, "TCP_KEEPIDLE");    // seconds
  SetOption(socket_.Get(), IPPROTO_TCP, TCP_KEEPINTVL, 10, "TCP_KEEPINTVL");  // seconds
  SetOption(socket_.Get(), IPPROTO_TCP, TCP_KEEPCNT, 3, "TCP_KEEPCNT");
  SetOption(socket_.Get(), IPPROTO_TCP, TCP_USER_TIMEOUT, 20000, "TCP_USER_TIMEOUT");  // ms, for data not acknowledged
  SetOption(socket_.Get(), IPPROTO_TCP, TCP_NODELAY, 1, "TCP_NODELAY");
}

bool Connection::Receive() {
  std::array<std::uint8_t, kChunkBytes> chunk;
  const ssize_t got = recv(socket_.Get(), chunk.data(), chunk.size(), 0);
  if (got < 0) return IsForLater(errno);
  if (got == 0) ended_ = true;
  received_.insert(received_.end(), chunk.begin(), chunk.begin() + got);
  return true;
}

void Connection::Answer(const ModbusFrame& frame, std::span<const std::uint8_t> pdu, SteadyTime now) {
  if (unsent_.empty()) last_sent_ = now;
  AppendFrame(frame.transaction, frame.unit, pdu, unsent_);
  received_.erase(received_.begin(), received_.begin() + static_cast<std::ptrdiff_t>(frame.bytes));
  frame_since_.reset();
  last_active_ = now;
  has_asked_ = true;
}

bool Connection::Send(SteadyTime now) {
  if (unsent_.empty()) return true;
  const ssize_t sent = send(socket_.Get(), unsent_.data(), unsent_.size(), MSG_NOSIGNAL);
  if (sent < 0) return IsForLater(errno);
  if (sent > 0) last_sent_ = now;
  unsent_.erase(unsent_.begin(), unsent_.begin() + sent);
  return true;
}

void Connection::WatchFrame(SteadyTime now) {
  if (received_.empty()) {
    frame_since_.reset();
  } else if (!frame_since_) {
    frame_since_ = now;
  }
}

SteadyTime Connection::Deadline(const ModbusLimits& limits) const {
  SteadyTime deadline = last_active_ + limits.idle_timeout;
  if (frame_since_) deadline = std::min(deadline, *frame_since_ + limits.frame_deadline);
  if (!unsent_.empty()) deadline = std::min(deadline, last_sent_ + limits.stall_deadline);
  return deadline;
}

}  // namespace granary
