// Each kind goes on until the server closes its connection, and begins again; the pauses are those of a client that
// wants to do harm with one connection, not those of a polite one.
#include "tests/bench/modbus_hostile.h"

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <random>
#include <string>
#include <system_error>
#include <thread>

#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/bench/modbus_load.h"
#include "tests/bench/modbus_rivals.h"

namespace granary::bench {
namespace {

using std::chrono::milliseconds;

constexpr auto kForEver = std::chrono::hours{1};

bool SendAll(int socket, const Bytes& bytes) {
  return send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
}

/// Reads whatever comes until the server closes.
void AwaitClose(int socket) {
  std::array<std::uint8_t, 4096> bytes;
  while (recv(socket, bytes.data(), bytes.size(), 0) > 0) {
  }
}

void HalfHeader(const char* from, std::uint16_t port) {
  const FileDescriptor client = ConnectFrom(from, port);
  if (SendAll(client.Get(), {0, 1, 0})) AwaitClose(client.Get());
}

/// A whole good request, a byte every 30 ms, again and again.
void Drip(const char* from, std::uint16_t port) {
  const FileDescriptor client = ConnectFrom(from, port);
  while (true) {
    for (const std::uint8_t byte : ReadRequest(1, 0, 125)) {
      if (!SendAll(client.Get(), {byte})) return;
      std::this_thread::sleep_for(milliseconds{30});
    }
  }
}

/// The same request as fast as it is answered.
void Storm(const char* from, std::uint16_t port, const Bytes& request, std::size_t reply_bytes) {
  const FileDescriptor client = ConnectFrom(from, port);
  Bytes reply(reply_bytes);
  while (SendAll(client.Get(), request) &&
         ReceiveAll(client.Get(), reply.data(), reply.size(), std::chrono::steady_clock::now() + kForEver)) {
  }
}

void QuantityZero(const char* from, std::uint16_t port) { Storm(from, port, ReadRequest(1, 0, 0), 9); }

/// Identification of an object that is not there: an exception from a server that knows the function, and from one that
/// does not.
void IdentityStorm(const char* from, std::uint16_t port) {
  Storm(from, port, {0, 1, 0, 0, 0, 5, 0, 43, 14, 4, 0x7F}, 9);
}

void NeverReads(const char* from, std::uint16_t port) {
  const FileDescriptor client = ConnectFrom(from, port);
  const Bytes request = ReadRequest(1, 0, 125);
  while (SendAll(client.Get(), request) || errno == EAGAIN) {
  }
}

void ConnectFlood(const char* from, std::uint16_t port) {
  const FileDescriptor client = ConnectFrom(from, port);
  // Reset instead of TIME-WAIT, or the flood would end for want of ports.
  const linger reset{.l_onoff = 1, .l_linger = 0};
  setsockopt(client.Get(), SOL_SOCKET, SO_LINGER, &reset, sizeof reset);
}

void PipelinedFlood(const char* from, std::uint16_t port) {
  const FileDescriptor client = ConnectFrom(from, port);
  Bytes requests;
  for (int i = 0; i < 1000; ++i) {
    const Bytes one = ReadRequest(static_cast<std::uint16_t>(i), 0, 125);
    requests.insert(requests.end(), one.begin(), one.end());
  }
  std::jthread reader([&client] { AwaitClose(client.Get()); });
  while (SendAll(client.Get(), requests)) {
  }
  shutdown(client.Get(), SHUT_RDWR);
}

void RandomBytes(const char* from, std::uint16_t port) {
  static std::mt19937 random(1);
  const FileDescriptor client = ConnectFrom(from, port);
  Bytes bytes(1 + random() % 300);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
  if (!SendAll(client.Get(), bytes)) return;
  shutdown(client.Get(), SHUT_WR);
  AwaitClose(client.Get());
}

constexpr HostileKind kKinds[] = {
    {"half header, then silence", HalfHeader}, {"one byte every 30 ms", Drip},
    {"quantity 0, storm", QuantityZero},       {"FC43 storm", IdentityStorm},
    {"never reads its replies", NeverReads},   {"connects and disconnects", ConnectFlood},
    {"pipelined flood", PipelinedFlood},       {"random bytes", RandomBytes},
};

}  // namespace

std::span<const HostileKind> HostileKinds() { return kKinds; }

HostileProcess::HostileProcess(std::span<const HostileKind> kinds, std::uint16_t port) {
  std::fflush(nullptr);
  pid_ = fork();
  if (pid_ < 0) throw std::system_error(errno, std::generic_category(), "fork");
  if (pid_ > 0) return;
  DieWithParent();
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    threads.emplace_back([kind = kinds[i], from = "127.0.2." + std::to_string(1 + i), port] {
      while (true) {
        try {
          kind.act(from.c_str(), port);
        } catch (const std::system_error&) {
          // refused, or the server takes no more: that is what it is here to try
          std::this_thread::sleep_for(milliseconds{1});
        }
      }
    });
  }
  for (auto& thread : threads) thread.join();
  std::_Exit(0);
}

HostileProcess::~HostileProcess() {
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

}  // namespace granary::bench
