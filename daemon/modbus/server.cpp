// One thread, one epoll set, no call that waits for a client: each connection is read in small turns, and only a
// complete, well-formed request is answered. A select loop around modbus_receive would let one slow client hold up all
// others for seconds. Every request takes one shared snapshot, so a block read never mixes two measurements.
#include "daemon/modbus/server.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <map>
#include <optional>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <system_error>
#include <tuple>
#include <utility>

#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>

#include "daemon/modbus/once_per_minute.h"

namespace granary {
namespace {

using Steady = std::chrono::steady_clock;

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
  const int flags = fcntl(socket, F_GETFL);
  if (flags < 0 || fcntl(socket, F_SETFL, flags | O_NONBLOCK) < 0) {
    throw std::system_error(errno, std::generic_category(), "modbus: fcntl O_NONBLOCK");
  }
}

FileDescriptor Checked(int fd, const char* call) {
  if (fd < 0) throw std::system_error(errno, std::generic_category(), call);
  return FileDescriptor(fd);
}

}  // namespace

/// What the server's thread owns.
class ModbusServer::Loop {
 public:
  Loop(FileDescriptor listener, const ModbusTcpOptions& options, ModbusUnits& units, ModbusTally& tally,
       ModbusLimits limits)
      : units_(units),
        tally_(tally),
        listener_(std::move(listener)),
        allow_(NetworksOf("allow", options.allow)),
        write_allow_(NetworksOf("write_allow", options.write_allow)),
        max_clients_(static_cast<std::size_t>(std::max(1, options.max_clients))),
        limits_(limits),
        epoll_(Checked(epoll_create1(EPOLL_CLOEXEC), "epoll_create1")),
        wake_(Checked(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK), "eventfd")) {
    RequireListening(listener_.Get());
    Watch(EPOLL_CTL_ADD, wake_.Get(), EPOLLIN);
    Watch(EPOLL_CTL_ADD, listener_.Get(), EPOLLIN);
  }

  ~Loop() { tally_.clients -= static_cast<std::uint32_t>(clients_.size()); }
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
      for (int i = 0; i < ready; ++i) {
        const int fd = events[i].data.fd;
        if (fd == listener_.Get()) newcomers = true;
        if (const auto client = clients_.find(fd); client != clients_.end()) {
          if (!Turn(client->second, events[i].events, now)) Close(client);
        }
      }
      CloseOverdue(now);
      // Last, because a descriptor closed above may come back as a newcomer's.
      if (newcomers) Accept(now);
      if (resume_accepting_ && now >= *resume_accepting_) {
        resume_accepting_.reset();
        Watch(EPOLL_CTL_MOD, listener_.Get(), EPOLLIN);
      }
    }
  }

 private:
  struct Client {
    Connection connection;
    bool may_write = false;
    std::uint32_t interest = EPOLLIN;
  };
  using Clients = std::map<int, Client>;

  void Watch(int operation, int fd, std::uint32_t interest) {
    epoll_event event{};
    event.events = interest;
    event.data.fd = fd;
    if (epoll_ctl(epoll_.Get(), operation, fd, &event) != 0) {
      throw std::system_error(errno, std::generic_category(), "epoll_ctl");
    }
  }

  int WaitMs(SteadyTime now) const {
    std::optional<SteadyTime> next = resume_accepting_;
    for (const auto& [fd, client] : clients_) {
      const SteadyTime deadline = client.connection.Deadline(limits_);
      if (!next || deadline < *next) next = deadline;
    }
    if (!next) return -1;
    const auto wait = std::chrono::ceil<std::chrono::milliseconds>(*next - now).count();
    return static_cast<int>(std::clamp<std::int64_t>(wait, 0, 60000));
  }

  /// Whether it may be read from: nothing complete is waiting, and it takes its answers.
  bool MayReceive(const Connection& connection) const {
    return !connection.Ended() && connection.UnsentBytes() < limits_.max_unsent_bytes &&
           connection.Next().state == FrameState::kIncomplete;
  }

  /// One client's turn. @return false when it is to be closed
  bool Turn(Client& client, std::uint32_t events, SteadyTime now) {
    Connection& connection = client.connection;
    if ((events & EPOLLERR) != 0) return false;
    if ((events & (EPOLLIN | EPOLLHUP)) != 0 && MayReceive(connection) && !connection.Receive()) return false;
    do {
      if (!AnswerComplete(client, now)) {
        (void)connection.Send(now);  // what it asked before it went wrong is still answered
        return false;
      }
      if (!connection.Send(now)) return false;
    } while (connection.UnsentBytes() == 0 && connection.Next().state == FrameState::kComplete);

    const bool unfinished = connection.Next().state == FrameState::kIncomplete;
    if (unfinished) connection.WatchFrame(now);
    if (connection.UnsentBytes() == 0 && unfinished && (connection.Ended() || (events & EPOLLHUP) != 0)) return false;
    const std::uint32_t interest = (MayReceive(connection) ? std::uint32_t{EPOLLIN} : 0u) |
                                   (connection.UnsentBytes() > 0 ? std::uint32_t{EPOLLOUT} : 0u);
    if (interest != client.interest) Watch(EPOLL_CTL_MOD, connection.Socket(), interest);
    client.interest = interest;
    return true;
  }

  /// Answers complete requests for as long as there is room. @return false when the stream is malformed
  bool AnswerComplete(Client& client, SteadyTime now) {
    Connection& connection = client.connection;
    while (connection.UnsentBytes() < limits_.max_unsent_bytes) {
      const ModbusFrame frame = connection.Next();
      if (frame.state == FrameState::kIncomplete) return true;
      if (frame.state == FrameState::kMalformed) {
        ++tally_.malformed;
        if (const auto count = malformed_log_.Count(now)) {
          spdlog::warn("modbus: {}: malformed frame, {}; closed ({} since the last such line)", connection.Peer(),
                       frame.fault, *count);
        }
        return false;
      }
      // Counted first, so that a request that reads the counter finds itself in it.
      ++tally_.requests;
      const Requester requester{connection.Peer(), client.may_write};
      connection.Answer(frame, units_.Answer(frame.unit, frame.pdu, requester), now);
    }
    return true;
  }

  void Accept(SteadyTime now) {
    constexpr int kPerTurn = 16;  // so that a flood of newcomers leaves time for the others
    for (int i = 0; i < kPerTurn; ++i) {
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
        Watch(EPOLL_CTL_MOD, listener_.Get(), 0);
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
        spdlog::warn("modbus: {} is not in modbus.tcp.allow; refused ({} since the last such line)", NameOf(peer),
                     *count);
      }
      return;
    }
    if (clients_.size() >= max_clients_) EvictOne(now);
    try {
      const int fd = socket.Get();
      Client client{Connection(std::move(socket), NameOf(peer), now), AnyContains(write_allow_, peer)};
      Watch(EPOLL_CTL_ADD, fd, client.interest);
      spdlog::debug("modbus: {} connected", client.connection.Peer());
      clients_.emplace(fd, std::move(client));
      ++tally_.clients;
    } catch (const std::system_error& error) {
      spdlog::warn("modbus: {}: {}; closed", NameOf(peer), error.what());
    }
  }

  /// Those who never asked anything go first, then whoever has been silent longest.
  void EvictOne(SteadyTime now) {
    const auto oldest = std::min_element(clients_.begin(), clients_.end(), [](const auto& a, const auto& b) {
      const Connection &first = a.second.connection, &second = b.second.connection;
      return std::tuple(first.HasAsked(), first.LastActive()) < std::tuple(second.HasAsked(), second.LastActive());
    });
    ++tally_.evicted;
    if (const auto count = evicted_log_.Count(now)) {
      spdlog::warn("modbus: {} closed to make room, {} clients are the most allowed ({} since the last such line)",
                   oldest->second.connection.Peer(), max_clients_, *count);
    }
    Close(oldest);
  }

  void CloseOverdue(SteadyTime now) {
    for (auto client = clients_.begin(); client != clients_.end();) {
      const auto current = client++;
      if (current->second.connection.Deadline(limits_) > now) continue;
      ++tally_.timed_out;
      spdlog::debug("modbus: {} timed out", current->second.connection.Peer());
      Close(current);
    }
  }

  void Close(Clients::iterator client) {
    clients_.erase(client);  // closing takes the descriptor out of the epoll set
    --tally_.clients;
  }

  ModbusUnits& units_;
  ModbusTally& tally_;
  FileDescriptor listener_;
  const std::vector<Network> allow_, write_allow_;
  const std::size_t max_clients_;
  const ModbusLimits limits_;
  FileDescriptor epoll_, wake_;
  Clients clients_;
  std::optional<SteadyTime> resume_accepting_;
  OncePerMinute malformed_log_, refused_log_, evicted_log_, accept_log_;
};

ModbusServer::ModbusServer(FileDescriptor listener, const ModbusTcpOptions& options, ModbusUnits& units,
                           ModbusTally& tally, ModbusLimits limits)
    : port_(BoundPort(listener.Get())),
      loop_(std::make_unique<Loop>(std::move(listener), options, units, tally, limits)),
      thread_([this](const std::stop_token& stop) { loop_->Run(stop); }) {}

ModbusServer::~ModbusServer() = default;

}  // namespace granary
