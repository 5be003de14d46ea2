// The fast client must cost less than the servers: requests are built beforehand, a reply is one recv, and only its
// header and length are looked at.
#include "tests/bench/modbus_load.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <ctime>
#include <optional>
#include <stdexcept>
#include <system_error>
#include <thread>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/epoll.h>
#include <sys/socket.h>

#include "tests/bench/modbus_rivals.h"

namespace granary::bench {
namespace {

using Steady = std::chrono::steady_clock;

constexpr int kRegisters = 125;
constexpr std::size_t kReplyBytes = 9 + 2 * kRegisters;

double Ms(Steady::duration time) { return std::chrono::duration<double, std::milli>(time).count(); }

double ProcessCpuSeconds() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

bool IsReply(const std::uint8_t* bytes) {
  return bytes[2] == 0 && bytes[3] == 0 && bytes[4] == 0 && bytes[5] == kReplyBytes - 6 && bytes[7] == 3 &&
         bytes[8] == 2 * kRegisters;
}

void PollUntil(std::uint16_t port, const std::string& from, std::chrono::milliseconds period, Steady::time_point start,
               Steady::time_point end, Polls& polls) {
  constexpr auto kPatience = std::chrono::seconds{2};
  std::optional<FileDescriptor> socket;
  std::array<std::uint8_t, kReplyBytes> reply;
  std::uint16_t transaction = 0;
  for (Steady::time_point due = start; due < end; due += period) {
    if (const auto now = Steady::now(); due + period < now) {
      const auto behind = (now - due) / period;
      polls.missed += static_cast<int>(behind);
      due += behind * period;
      if (due >= end) return;
    }
    std::this_thread::sleep_until(due);
    const auto woken = Steady::now();
    polls.late_ms.push_back(Ms(woken - due));
    try {
      if (!socket) socket = ConnectFrom(from, port);
    } catch (const std::system_error&) {
      ++polls.failures;
      continue;
    }
    const Bytes request = ReadRequest(++transaction, 0, kRegisters);
    const auto asked = Steady::now();
    const bool answered =
        send(socket->Get(), request.data(), request.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(request.size()) &&
        ReceiveAll(socket->Get(), reply.data(), reply.size(), asked + kPatience) && IsReply(reply.data()) &&
        ((reply[0] << 8) | reply[1]) == transaction;
    if (answered) {
      polls.latencies_ms.push_back(Ms(Steady::now() - asked));
    } else {
      ++polls.failures;
      socket.reset();
    }
  }
}

}  // namespace

Bytes ReadRequest(std::uint16_t transaction, int address, int count) {
  const auto high = [](int word) { return static_cast<std::uint8_t>(word >> 8); };
  const auto low = [](int word) { return static_cast<std::uint8_t>(word); };
  return {high(transaction), low(transaction), 0, 0, 0, 6, 0, 3, high(address), low(address), high(count), low(count)};
}

FileDescriptor ConnectFrom(const std::string& from, std::uint16_t port) {
  FileDescriptor client(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  inet_pton(AF_INET, from.c_str(), &address.sin_addr);
  const int on = 1;
  const timeval patience{.tv_sec = 2, .tv_usec = 0};
  // Without a port of its own until connect, so that many connections from one address find ports that are free.
  if (client.Get() < 0 || setsockopt(client.Get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on) != 0 ||
      setsockopt(client.Get(), IPPROTO_IP, IP_BIND_ADDRESS_NO_PORT, &on, sizeof on) != 0 ||
      setsockopt(client.Get(), SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience) != 0 ||
      bind(client.Get(), reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
    throw std::system_error(errno, std::generic_category(), "socket of a client");
  }
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(port);
  if (connect(client.Get(), reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
    throw std::system_error(errno, std::generic_category(), "connect");
  }
  return client;
}

bool ReceiveAll(int socket, std::uint8_t* bytes, std::size_t count, Steady::time_point until) {
  for (std::size_t got = 0; got < count;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Steady::now()).count();
    pollfd ready{socket, POLLIN, 0};
    if (left <= 0 || poll(&ready, 1, static_cast<int>(left)) != 1) return false;
    const ssize_t n = recv(socket, bytes + got, count - got, 0);
    if (n <= 0) return false;
    got += static_cast<std::size_t>(n);
  }
  return true;
}

Flow RunFlow(const ServerProcess& server, int connections, int outstanding, std::chrono::milliseconds duration) {
  struct Client {
    FileDescriptor socket;
    Bytes received;
    std::size_t got = 0;
  };
  const FileDescriptor poll(epoll_create1(EPOLL_CLOEXEC));
  const Bytes request = ReadRequest(0, 0, kRegisters);
  Bytes requests;
  for (int i = 0; i < outstanding; ++i) requests.insert(requests.end(), request.begin(), request.end());
  std::vector<Client> clients(connections);
  const auto ask = [&](const Client& client, std::size_t count) {
    const auto bytes = static_cast<ssize_t>(count * request.size());
    if (send(client.socket.Get(), requests.data(), static_cast<std::size_t>(bytes), MSG_NOSIGNAL) != bytes) {
      throw std::runtime_error("a server does not take a request");
    }
  };
  for (std::size_t i = 0; i < clients.size(); ++i) {
    clients[i].socket = ConnectFrom("127.0.0.1", server.Port());
    clients[i].received.resize(static_cast<std::size_t>(outstanding) * kReplyBytes);
    epoll_event event{.events = EPOLLIN, .data = {.u64 = i}};
    if (epoll_ctl(poll.Get(), EPOLL_CTL_ADD, clients[i].socket.Get(), &event) != 0) {
      throw std::system_error(errno, std::generic_category(), "epoll_ctl");
    }
  }
  for (const auto& client : clients) ask(client, static_cast<std::size_t>(outstanding));

  Flow flow;
  std::array<epoll_event, 64> events;
  const auto run = [&](std::chrono::milliseconds time) {
    const auto start = Steady::now(), end = start + time;
    auto now = start;
    for (flow.requests = 0; now < end; now = Steady::now()) {
      const int ready = epoll_wait(poll.Get(), events.data(), events.size(), 2000);
      if (ready <= 0) throw std::runtime_error("a server has stopped answering");
      for (int i = 0; i < ready; ++i) {
        Client& client = clients[events[i].data.u64];
        Bytes& bytes = client.received;
        const ssize_t n = recv(client.socket.Get(), bytes.data() + client.got, bytes.size() - client.got, 0);
        if (n <= 0) throw std::runtime_error("a server closed a connection");
        client.got += static_cast<std::size_t>(n);
        const std::size_t whole = client.got / kReplyBytes;
        if (whole == 0) continue;
        for (std::size_t reply = 0; reply < whole; ++reply) {
          if (!IsReply(bytes.data() + reply * kReplyBytes)) throw std::runtime_error("a wrong reply");
        }
        client.got -= whole * kReplyBytes;
        std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(whole * kReplyBytes), client.got, bytes.begin());
        flow.requests += whole;
        ask(client, whole);
      }
    }
    flow.seconds = std::chrono::duration<double>(now - start).count();
  };
  run(std::chrono::milliseconds{300});  // warm
  const double server_before = server.CpuSeconds(), client_before = ProcessCpuSeconds();
  run(duration);
  flow.server_cpu_seconds = server.CpuSeconds() - server_before;
  flow.client_cpu_seconds = ProcessCpuSeconds() - client_before;
  return flow;
}

Polls RunPollers(std::uint16_t port, int clients, std::chrono::milliseconds period,
                 std::chrono::milliseconds duration) {
  std::vector<Polls> each(clients);
  const auto start = Steady::now() + period, end = start + duration;
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < clients; ++i) {
      threads.emplace_back([&, i] {
        each[i].prompt = GoFirst();
        PollUntil(port, "127.0.1." + std::to_string(1 + i), period, start + i * period / clients, end, each[i]);
      });
    }
  }
  Polls all;
  all.prompt = true;
  for (const Polls& polls : each) {
    all.latencies_ms.insert(all.latencies_ms.end(), polls.latencies_ms.begin(), polls.latencies_ms.end());
    all.late_ms.insert(all.late_ms.end(), polls.late_ms.begin(), polls.late_ms.end());
    all.failures += polls.failures;
    all.missed += polls.missed;
    all.prompt = all.prompt && polls.prompt;
  }
  std::sort(all.latencies_ms.begin(), all.latencies_ms.end());
  std::sort(all.late_ms.begin(), all.late_ms.end());
  return all;
}

}  // namespace granary::bench
