// A PLC on a socket that behaves as it is told, and remembers what was written to it.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <span>
#include <stdexcept>
#include <stop_token>
#include <thread>
#include <utility>
#include <vector>

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include "daemon/modbus/framing.h"
#include "daemon/modbus/socket.h"

namespace granary::test {

/// Serves FC3 and FC16 on all 65536 holding registers from a thread of its own, one client at a time or several. Any
/// thread may call any method.
class FakePlc {
 public:
  enum class Manner {
    kGood,
    kSilent,             ///< takes requests, answers none
    kDrips,              ///< answers a byte at a time, for ever
    kRubbish,            ///< answers with bytes that are no Modbus
    kWrongTransaction,   ///< answers another request than it was asked
    kClosesInTheMiddle,  ///< sends half an answer and closes
    kClosesAtOnce,       ///< closes each connection as soon as it is there
    kClosesAfterAnswer   ///< answers, then closes: the connection is not kept
  };
  struct Written {
    int address;
    std::vector<std::uint16_t> words;
  };

  /// @param port 0 takes a free one
  explicit FakePlc(std::uint16_t port = 0, Manner manner = Manner::kGood)
      : listener_(ListenTcp("127.0.0.1", port)), port_(BoundPort(listener_.Get())), manner_(manner) {
    thread_ = std::jthread([this](const std::stop_token& stop) { Run(stop); });
  }
  ~FakePlc() {
    thread_.request_stop();
    thread_.join();
  }
  FakePlc(const FakePlc&) = delete;
  FakePlc& operator=(const FakePlc&) = delete;

  [[nodiscard]] std::uint16_t Port() const { return port_; }

  void Behave(Manner manner) {
    const std::scoped_lock lock(mutex_);
    manner_ = manner;
  }
  /// Requests that touch `address` get this exception; 0 ends it.
  void Refuse(int address, int exception) {
    const std::scoped_lock lock(mutex_);
    refused_[address] = exception;
  }
  /// Requests that touch `address` get no answer.
  void Ignore(int address) {
    const std::scoped_lock lock(mutex_);
    ignored_ = address;
  }
  /// This register keeps `word`, whatever is written.
  void Stick(int address, std::uint16_t word) {
    const std::scoped_lock lock(mutex_);
    stuck_[address] = registers_[static_cast<std::size_t>(address)] = word;
  }
  void Unstick() {
    const std::scoped_lock lock(mutex_);
    stuck_.clear();
  }
  void Set(int address, const std::vector<std::uint16_t>& words) {
    const std::scoped_lock lock(mutex_);
    std::copy(words.begin(), words.end(), registers_.begin() + address);
  }
  [[nodiscard]] std::uint16_t At(int address) const {
    const std::scoped_lock lock(mutex_);
    return registers_[static_cast<std::size_t>(address)];
  }
  /// All FC16 requests that were taken, oldest first.
  [[nodiscard]] std::vector<Written> Writes() const {
    const std::scoped_lock lock(mutex_);
    return writes_;
  }
  [[nodiscard]] int Requests() const { return Read(requests_); }
  [[nodiscard]] int Reads() const { return Read(reads_); }
  [[nodiscard]] int Connections() const { return Read(connections_); }
  /// Bytes that kDrips has sent, of kDrippedAnswer.
  [[nodiscard]] std::size_t Dripped() const { return dripped_; }
  static constexpr std::size_t kDrippedAnswer = 206;

  /// False when that many have not come in twenty seconds, a guard against hanging.
  bool AwaitWrites(std::size_t count) {
    return Await([&] { return writes_.size() >= count; });
  }
  bool AwaitRequests(int count) {
    return Await([&] { return requests_ >= count; });
  }
  bool AwaitReads(int count) {
    return Await([&] { return reads_ >= count; });
  }
  /// Connections that have ended, on this side too.
  bool AwaitClosed(int count) {
    return Await([&] { return closed_ >= count; });
  }
  /// Connections that the client has reset instead of closed.
  bool AwaitResets(int count) {
    return Await([&] { return resets_ >= count; });
  }

 private:
  using Bytes = std::vector<std::uint8_t>;
  static constexpr int kDripMs = 20;

  int Read(const int& counter) const {
    const std::scoped_lock lock(mutex_);
    return counter;
  }
  template <typename Condition>
  bool Await(Condition met) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds{20}, met);
  }

  void Run(const std::stop_token& stop) {
    const FileDescriptor wake(eventfd(0, EFD_CLOEXEC));
    const std::stop_callback on_stop(stop, [&] { eventfd_write(wake.Get(), 1); });
    std::map<int, std::pair<FileDescriptor, Bytes>> clients;
    while (!stop.stop_requested()) {
      std::vector<pollfd> polled{{wake.Get(), POLLIN, 0}, {listener_.Get(), POLLIN, 0}};
      for (const auto& [fd, client] : clients) polled.push_back({fd, POLLIN, 0});
      poll(polled.data(), polled.size(), Drips() ? kDripMs : -1);
      if ((polled[1].revents & POLLIN) != 0) Accept(clients);
      for (std::size_t i = 2; i < polled.size(); ++i) {
        if (polled[i].revents == 0 || Turn(clients.at(polled[i].fd))) continue;
        clients.erase(polled[i].fd);
        const std::scoped_lock lock(mutex_);
        ++closed_;
        changed_.notify_all();
      }
      if (Drips()) {
        for (const auto& [fd, client] : clients) Drip(fd);
      }
    }
  }

  void Accept(std::map<int, std::pair<FileDescriptor, Bytes>>& clients) {
    FileDescriptor client(accept4(listener_.Get(), nullptr, nullptr, SOCK_CLOEXEC));
    if (client.Get() < 0) return;
    const std::scoped_lock lock(mutex_);
    ++connections_;
    changed_.notify_all();
    const int fd = client.Get();
    if (manner_ != Manner::kClosesAtOnce) clients.insert_or_assign(fd, std::pair(std::move(client), Bytes{}));
  }

  /// False when the connection ends.
  bool Turn(std::pair<FileDescriptor, Bytes>& client) {
    auto& [socket, received] = client;
    std::array<std::uint8_t, 512> chunk;
    const ssize_t got = recv(socket.Get(), chunk.data(), chunk.size(), 0);
    if (got < 0 && errno == ECONNRESET) {
      const std::scoped_lock lock(mutex_);
      ++resets_;
      changed_.notify_all();
    }
    if (got <= 0) return false;
    received.insert(received.end(), chunk.begin(), chunk.begin() + got);
    const ModbusFrame frame = ParseFrame(received);
    if (frame.state == FrameState::kMalformed) throw std::logic_error("the PLC client sends no Modbus");
    if (frame.state == FrameState::kIncomplete) return true;
    const std::scoped_lock lock(mutex_);
    ++requests_;
    Bytes reply;
    const bool stays = Reply(frame, reply);
    received.erase(received.begin(), received.begin() + static_cast<std::ptrdiff_t>(frame.bytes));
    if (!reply.empty()) send(socket.Get(), reply.data(), reply.size(), MSG_NOSIGNAL);
    changed_.notify_all();
    return stays;
  }

  /// With the lock held. @return whether the connection stays
  bool Reply(const ModbusFrame& frame, Bytes& reply) {
    const int first = (frame.pdu[1] << 8) | frame.pdu[2], count = (frame.pdu[3] << 8) | frame.pdu[4];
    if (ignored_ >= first && ignored_ < first + count) return true;
    switch (manner_) {
      case Manner::kSilent:
      case Manner::kDrips:
        return true;
      case Manner::kRubbish:
        reply.assign(64, 0xA5);
        return true;
      case Manner::kWrongTransaction:
        AppendFrame(static_cast<std::uint16_t>(frame.transaction + 1), frame.unit, Answer(frame.pdu), reply);
        return true;
      case Manner::kClosesInTheMiddle:
        AppendFrame(frame.transaction, frame.unit, Answer(frame.pdu), reply);
        reply.resize(reply.size() / 2);
        return false;
      case Manner::kGood:
      case Manner::kClosesAtOnce:
      case Manner::kClosesAfterAnswer:
        AppendFrame(frame.transaction, frame.unit, Answer(frame.pdu), reply);
        return manner_ != Manner::kClosesAfterAnswer;
    }
    throw std::logic_error("no such manner");
  }

  Bytes Answer(std::span<const std::uint8_t> pdu) {
    const auto word = [&](std::size_t at) { return (pdu[at] << 8) | pdu[at + 1]; };
    const int address = word(1), count = word(3);
    for (const auto& [refused, exception] : refused_) {
      if (exception == 0 || refused < address || refused >= address + count) continue;
      return {static_cast<std::uint8_t>(pdu[0] | 0x80), static_cast<std::uint8_t>(exception)};
    }
    if (pdu[0] == 16) {
      Written written{address, {}};
      for (int i = 0; i < count; ++i) {
        const auto value = static_cast<std::uint16_t>(word(6 + 2 * static_cast<std::size_t>(i)));
        written.words.push_back(value);
        const auto stuck = stuck_.find(address + i);
        registers_.at(static_cast<std::size_t>(address + i)) = stuck == stuck_.end() ? value : stuck->second;
      }
      writes_.push_back(std::move(written));
      return {pdu.begin(), pdu.begin() + 5};
    }
    ++reads_;
    Bytes reply{pdu[0], static_cast<std::uint8_t>(2 * count)};
    for (int i = 0; i < count; ++i) {
      const std::uint16_t value = registers_.at(static_cast<std::size_t>(address + i));
      reply.push_back(static_cast<std::uint8_t>(value >> 8));
      reply.push_back(static_cast<std::uint8_t>(value));
    }
    return reply;
  }

  [[nodiscard]] bool Drips() const {
    const std::scoped_lock lock(mutex_);
    return manner_ == Manner::kDrips && requests_ > 0;
  }
  /// Begins a reply of 200 bytes, all of them plausible.
  void Drip(int fd) {
    static constexpr std::array<std::uint8_t, 9> kHead{0, 1, 0, 0, 0, 200, 1, 3, 198};
    const std::uint8_t byte = dripped_ < kHead.size() ? kHead[dripped_] : 0;
    if (send(fd, &byte, 1, MSG_NOSIGNAL) == 1) ++dripped_;
  }

  FileDescriptor listener_;
  const std::uint16_t port_;
  std::atomic<std::size_t> dripped_ = 0;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  Manner manner_;
  std::map<int, int> refused_;
  int ignored_ = -1;
  std::map<int, std::uint16_t> stuck_;
  std::array<std::uint16_t, 65536> registers_{};
  std::vector<Written> writes_;
  int requests_ = 0, reads_ = 0, connections_ = 0, closed_ = 0, resets_ = 0;

  std::jthread thread_;
};

}  // namespace granary::test
