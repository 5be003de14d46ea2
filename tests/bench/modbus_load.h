// The clients of modbus_bench that behave: one that asks as fast as it can, and pollers as a SCADA has them.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "daemon/modbus/socket.h"

namespace granary::bench {

using Bytes = std::vector<std::uint8_t>;

/// FC3 of `count` registers from `address`, unit 1 or the first: unit 0.
[[nodiscard]] Bytes ReadRequest(std::uint16_t transaction, int address, int count);
/// A blocking connection from `from`, an address of 127.0.0.0/8. @throws std::system_error
[[nodiscard]] FileDescriptor ConnectFrom(const std::string& from, std::uint16_t port);
/// Receives `count` bytes. @return false when the peer closed, or had not sent them by `until`
bool ReceiveAll(int socket, std::uint8_t* bytes, std::size_t count, std::chrono::steady_clock::time_point until);

struct Flow {
  double seconds = 0;
  std::uint64_t requests = 0;
  double client_cpu_seconds = 0;
  double server_cpu_seconds = 0;
};

class ServerProcess;

/// `connections` connections, `outstanding` requests of 125 registers waiting for their answers on each, from one
/// thread. Of each reply header and length are checked.
/// @throws std::runtime_error for a wrong reply or a closed connection
[[nodiscard]] Flow RunFlow(const ServerProcess& server, int connections, int outstanding,
                           std::chrono::milliseconds duration);

struct Polls {
  std::vector<double> latencies_ms;  ///< from the request to the whole reply, of those answered
  std::vector<double> late_ms;       ///< how late the poller itself was woken: what the machine adds
  int failures = 0;                  ///< no answer within 2 s, a closed connection, a wrong answer
  int missed = 0;                    ///< polls left out because the one before was still waiting
  bool prompt = false;               ///< the pollers had real-time priority
};

/// `clients` clients, each a thread with an address of its own, polling 125 registers every `period`. They reconnect
/// after a failure. They stand for other machines: where that is permitted they have real-time priority, so that what
/// keeps this machine busy delays the server alone.
[[nodiscard]] Polls RunPollers(std::uint16_t port, int clients, std::chrono::milliseconds period,
                               std::chrono::milliseconds duration);

}  // namespace granary::bench
