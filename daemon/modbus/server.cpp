// One thread, one epoll set, no call that waits for a client: each connection is served in small turns, and only a
// complete, well-formed request is answered. A select loop around modbus_receive would let one slow client hold up all
// others for seconds. In the steady state a request costs one recv, one send and a share of an epoll_wait: no timers,
// no change of interest, no walk over all clients.
#include "daemon/modbus/server.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <exception>
#include <optional>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include <spdlog/spdlog.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>

#include "daemon/modbus/once_per_minute.h"
#include "daemon/modbus/prompt_thread.h"
#include "daemon/modbus/server_eviction.h"

namespace granary {
namespace {

using Steady = std::chrono::steady_clock;

// Turns are small, so that whoever sends much waits for those who send little. What a turn leaves is found again by the
// next epoll_wait, behind everybody else.
constexpr int kFramesPerTurn = 16;
constexpr int kHandshakesPerRound = 4;  // each may cost a millisecond of arithmetic
constexpr int kNewcomersPerRound = 16;
constexpr std::chrono::milliseconds kSweepEvery{10};  // how exactly deadlines are kept

std::vector<Network> NetworksOf(const std::string& key, const std::vector<std::string>& texts) {
  std::vector<Network> networks;
  for (const auto& text : texts) {
    const auto network = ParseNetwork(text);
    if (!network) throw std::invalid_argument(key + ": \"" + text + "\" is no network; write e.g. \"192.168.7.0/24\"");
    networks.push_back(*network);
  }
  return networks;
}

bool AnyContains(const std::vector<Network>& networks, const sockaddr_storage& peer) {
  return std::any_of(networks.begin(), networks.end(), [&](const Network& network) { return Contains(network, peer); });
}

void RequireListening(int socket) {
  int listens = 0;
  socklen_t size = sizeof listens;
  if (getsockopt(socket, SOL_SOCKET, SO_ACCEPTCONN, &listens, &size) != 0 || listens == 0) {
    throw std::runtime_error("modbus: the socket given does not listen");
  }
}

}  // namespace

/// What the server's thread owns.
class ModbusServer::Loop {
 public:
  Loop(FileDescriptor listener, const ModbusTcpOptions& options, ModbusUnits& units, ModbusTally& tally,
       ModbusLimits limits, std::shared_ptr<const TlsContext> tls)
      : units_(units),
        tally_(tally),
        listener_(std::move(listener)),
        tls_(std::move(tls)),
        key_(tls_ ? "modbus.tls" : "modbus.tcp"),
        allow_(NetworksOf(key_ + ".allow", options.allow)),
        write_allow_(NetworksOf(key_ + ".write_allow", options.write_allow)),
        max_clients_(static_cast<std::size_t>(std::max(1, options.max_clients))),
        limits_(limits),
        epoll_(Checked(epoll_create1(EPOLL_CLOEXEC), "epoll_create1")),
        wake_(Checked(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK), "eventfd")) {
    clients_.reserve(max_clients_);  // so that adding one that is watched cannot throw
    RequireListening(listener_.Get());
    PrepareListener(listener_.Get());
    Watch(EPOLL_CTL_ADD, wake_.Get(), EPOLLIN, &wake_);
    Watch(EPOLL_CTL_ADD, listener_.Get(), EPOLLIN, &listener_);
  }

  ~Loop() {
    while (!clients_.empty()) Close(*clients_.back(), Steady::now());
  }
  Loop(const Loop&) = delete;
  Loop& operator=(const Loop&) = delete;

  void Run(const std::stop_token& stop) {
    const std::stop_callback wake(stop, [this] { eventfd_write(wake_.Get(), 1); });
    std::array<epoll_event, 64> events;
    while (!stop.stop_requested()) {
      const int ready = epoll_wait(epoll_.Get(), events.data(), events.size(), WaitMs(Steady::now()));
      if (ready < 0 && errno != EINTR) throw std::system_error(errno, std::generic_category(), "epoll_wait");
      const SteadyTime now = Steady::now();
      bool newcomers = false;
      int handshakes = 0;
      for (int i = 0; i < ready; ++i) {
        if (events[i].data.ptr == &listener_) newcomers = true;
        if (events[i].data.ptr == &listener_ || events[i].data.ptr == &wake_) continue;
        auto& client = *static_cast<Client*>(events[i].data.ptr);
        if (client.connection.InHandshake() && ++handshakes > kHandshakesPerRound) continue;
        if (!SafeTurn(client, events[i].events, now)) Close(client, now);
      }
      // Only now may clients go that are not this event's: above they may still be named by a later event.
      if (now >= sweep_at_) Sweep(now);
      if (newcomers) Accept(now);
      if (resume_accepting_ && now >= *resume_accepting_) {
        resume_accepting_.reset();
        Watch(EPOLL_CTL_MOD, listener_.Get(), EPOLLIN, &listener_);
      }
    }
  }

 private:
  struct Client {
    Connection connection;
    Network host;
    bool address_may_write = false;
    std::uint32_t interest = EPOLLIN;
    std::size_t place = 0;  ///< index in clients_
  };

  void Watch(int operation, int fd, std::uint32_t interest, void* whose) {
    epoll_event event{};
    event.events = interest;
    event.data.ptr = whose;
    if (epoll_ctl(epoll_.Get(), operation, fd, &event) != 0) {
      throw std::system_error(errno, std::generic_category(), "epoll_ctl");
    }
  }

  int WaitMs(SteadyTime now) const {
    const SteadyTime next = std::min(sweep_at_, resume_accepting_.value_or(SteadyTime::max()));
    if (next == SteadyTime::max()) return -1;
    const auto wait = std::chrono::ceil<std::chrono::milliseconds>(next - now).count();
    return static_cast<int>(std::clamp<std::int64_t>(wait, 0, 60000));
  }

  /// Whether it may be read from: nothing complete is waiting, and it takes its answers.
  bool MayReceive(const Connection& connection) const {
    return !connection.Ended() && connection.UnsentBytes() < limits_.max_unsent_bytes &&
           connection.Next().state == FrameState::kIncomplete;
  }

  /// A turn that cannot end the thread, whatever the client sent.
  bool SafeTurn(Client& client, std::uint32_t events, SteadyTime now) {
    try {
      return Turn(client, events, now);
    } catch (const std::exception& error) {
      if (const auto count = error_log_.Count(now)) {
        spdlog::error("modbus: {}: {}; closed ({} since the last such line)", client.connection.Peer(), error.what(),
                      *count);
      }
      return false;
    }
  }

  /// One client's turn. @return false when it is to be closed
  bool Turn(Client& client, std::uint32_t events, SteadyTime now) {
    Connection& connection = client.connection;
    if ((events & EPOLLERR) != 0) return false;
    if ((events & (EPOLLIN | EPOLLHUP)) != 0 && MayReceive(connection) && !connection.Receive(now)) {
      NoteTlsFault(connection, now);
      static_cast<void>(connection.Send(now));  // TLS says why it goes
      return false;
    }
    const bool sound = AnswerSome(client, now);
    // What it asked before it went wrong is still answered.
    if (!connection.Send(now) || !sound) return false;

    const bool waiting = connection.Next().state != FrameState::kIncomplete;
    if (!waiting) connection.WatchFrame(now);
    const bool over = connection.Ended() || (events & EPOLLHUP) != 0;
    if (over && !waiting && connection.UnsentBytes() == 0) {
      if (connection.InHandshake()) NoteRefused(connection, "left in the middle of the handshake", now);
      return false;
    }
    // Room to send is there at once, nearly always: so a client with requests left over gets its next turn.
    const std::uint32_t interest = (MayReceive(connection) ? std::uint32_t{EPOLLIN} : 0u) |
                                   (waiting || connection.UnsentBytes() > 0 ? std::uint32_t{EPOLLOUT} : 0u);
    if (interest != client.interest) Watch(EPOLL_CTL_MOD, connection.Socket(), interest, &client);
    client.interest = interest;
    sweep_at_ = std::min(sweep_at_, connection.Deadline(limits_));
    return true;
  }

  /// Answers complete requests for as long as there is room. @return false when the stream is malformed
  bool AnswerSome(Client& client, SteadyTime now) {
    Connection& connection = client.connection;
    for (int i = 0; i < kFramesPerTurn && connection.UnsentBytes() < limits_.max_unsent_bytes; ++i) {
      const ModbusFrame frame = connection.Next();
      if (frame.state == FrameState::kIncomplete) return true;
      if (frame.state == FrameState::kMalformed) {
        NoteMalformed(connection, "malformed frame, ", frame.fault, now);
        return false;
      }
      // Counted first, so that a request that reads the counter finds itself in it.
      ++tally_.requests;
      const Requester requester{connection.Peer(), client.address_may_write && connection.RoleMayWrite()};
      connection.Answer(frame, units_.Answer(frame.unit, frame.pdu, requester), now);
    }
    return true;
  }

  void NoteTlsFault(const Connection& connection, SteadyTime now) {
    const std::string fault = connection.TlsFault();
    if (fault.empty()) return;
    if (connection.InHandshake()) {
      NoteRefused(connection, "TLS: " + fault, now);
    } else {
      NoteMalformed(connection, "TLS: ", fault, now);
    }
  }

  void NoteMalformed(const Connection& connection, std::string_view what, std::string_view fault, SteadyTime now) {
    ++tally_.malformed;
    if (const auto count = malformed_log_.Count(now)) {
      spdlog::warn("modbus: {}: {}{}; closed ({} since the last such line)", connection.Peer(), what, fault, *count);
    }
  }

  void NoteRefused(const Connection& connection, const std::string& why, SteadyTime now) {
    ++tally_.refused;
    if (const auto count = handshake_log_.Count(now)) {
      spdlog::warn("modbus: {}: {}; refused ({} since the last such line)", connection.Peer(), why, *count);
    }
  }

  void Accept(SteadyTime now) {
    for (int i = 0; i < kNewcomersPerRound; ++i) {
      sockaddr_storage peer{};
      socklen_t size = sizeof peer;
      const int fd = accept4(listener_.Get(), reinterpret_cast<sockaddr*>(&peer), &size, SOCK_NONBLOCK | SOCK_CLOEXEC);
      if (fd < 0) {
        if (errno == EAGAIN || errno == EWOULDBLOCK) return;
        if (errno == EINTR || errno == ECONNABORTED) continue;
        // Out of descriptors or memory: the newcomer stays in the queue, so look away for a while or spin.
        if (const auto count = accept_log_.Count(now)) {
          spdlog::error("modbus: accept: {} ({} since the last such line)", std::generic_category().message(errno),
                        *count);
        }
        Watch(EPOLL_CTL_MOD, listener_.Get(), 0, &listener_);
        resume_accepting_ = now + std::chrono::seconds{1};
        return;
      }
      Admit(FileDescriptor(fd), peer, now);
    }
  }

  void Admit(FileDescriptor socket, const sockaddr_storage& peer, SteadyTime now) {
    if (!AnyContains(allow_, peer)) {
      ++tally_.refused;
      if (const auto count = refused_log_.Count(now)) {
        spdlog::warn("modbus: {} is not in {}.allow; refused ({} since the last such line)", NameOf(peer), key_,
                     *count);
      }
      return;
    }
    if (clients_.size() >= max_clients_) EvictOne(now);
    try {
      std::optional<TlsSession> session;
      if (tls_) session.emplace(*tls_);
      auto client = std::make_unique<Client>(
          Client{.connection = Connection(std::move(socket), NameOf(peer), now, std::move(session)),
                 .host = HostOf(peer),
                 .address_may_write = AnyContains(write_allow_, peer),
                 .place = clients_.size()});
      Watch(EPOLL_CTL_ADD, client->connection.Socket(), client->interest, client.get());
      spdlog::debug("modbus: {} connected", client->connection.Peer());
      sweep_at_ = std::min(sweep_at_, client->connection.Deadline(limits_));
      clients_.push_back(std::move(client));
      ++tally_.clients;
    } catch (const std::exception& error) {
      if (const auto count = error_log_.Count(now)) {
        spdlog::error("modbus: {}: {}; closed ({} since the last such line)", NameOf(peer), error.what(), *count);
      }
    }
  }

  void EvictOne(SteadyTime now) {
    std::vector<Tenant> tenants;
    tenants.reserve(clients_.size());
    for (const auto& client : clients_) {
      tenants.push_back({client->host, client->connection.FirstAsked(), client->connection.LastActive()});
    }
    Client& evicted = *clients_[ChooseEvicted(tenants, now)];
    ++tally_.evicted;
    if (const auto count = evicted_log_.Count(now)) {
      spdlog::warn("modbus: {} closed to make room, {} clients are the most allowed ({} since the last such line)",
                   evicted.connection.Peer(), max_clients_, *count);
    }
    Close(evicted, now);
  }

  /// Closes whom a deadline has passed, and learns when the next one may. Between sweeps `sweep_at_` is only ever
  /// early: a deadline that moved away is found out here.
  void Sweep(SteadyTime now) {
    SteadyTime next = SteadyTime::max();
    for (std::size_t i = clients_.size(); i-- > 0;) {
      Client& client = *clients_[i];
      const SteadyTime deadline = client.connection.Deadline(limits_);
      if (deadline > now) {
        next = std::min(next, deadline);
        continue;
      }
      ++tally_.timed_out;
      spdlog::debug("modbus: {} timed out", client.connection.Peer());
      Close(client, now);
    }
    sweep_at_ = next == SteadyTime::max() ? next : std::max(next, now + kSweepEvery);
  }

  void Close(Client& client, SteadyTime now) {
    client.connection.SayGoodbye(now);
    const std::size_t place = client.place;
    std::swap(clients_[place], clients_.back());
    clients_[place]->place = place;
    clients_.pop_back();  // closing takes the descriptor out of the epoll set
    --tally_.clients;
  }

  ModbusUnits& units_;
  ModbusTally& tally_;
  FileDescriptor listener_;
  const std::shared_ptr<const TlsContext> tls_;
  const std::string key_;
  const std::vector<Network> allow_, write_allow_;
  const std::size_t max_clients_;
  const ModbusLimits limits_;
  FileDescriptor epoll_, wake_;
  std::vector<std::unique_ptr<Client>> clients_;
  SteadyTime sweep_at_ = SteadyTime::max();  ///< no deadline passes before
  std::optional<SteadyTime> resume_accepting_;
  OncePerMinute malformed_log_, refused_log_, evicted_log_, accept_log_, handshake_log_, error_log_;
};

ModbusServer::ModbusServer(FileDescriptor listener, const ModbusTcpOptions& options, ModbusUnits& units,
                           ModbusTally& tally, ModbusLimits limits, std::shared_ptr<const TlsContext> tls)
    : port_(BoundPort(listener.Get())),
      loop_(std::make_unique<Loop>(std::move(listener), options, units, tally, limits, std::move(tls))),
      thread_([this](const std::stop_token& stop) {
        BePrompt("modbus");
        loop_->Run(stop);
      }) {}

ModbusServer::~ModbusServer() = default;

}  // namespace granary
