// Two clients for the loopback tests: libmodbus, as a foreign master, and a bare socket for what no master would send.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <vector>

#include <arpa/inet.h>
#include <modbus/modbus.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include "daemon/modbus/socket.h"

namespace granary::test {

using Bytes = std::vector<std::uint8_t>;

/// Guards against a test that hangs; no test waits for it to pass.
inline constexpr int kGuardMs = 20000;

class RawClient {
 public:
  /// @param receive_buffer_bytes 0 leaves the system's
  explicit RawClient(std::uint16_t port, int receive_buffer_bytes = 0)
      : socket_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    if (receive_buffer_bytes > 0) {
      setsockopt(socket_.Get(), SOL_SOCKET, SO_RCVBUF, &receive_buffer_bytes, sizeof receive_buffer_bytes);
    }
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (connect(socket_.Get(), reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
      throw std::runtime_error("cannot connect to the server under test");
    }
  }

  /// False when the server has closed.
  bool Send(const Bytes& bytes) {
    return send(socket_.Get(), bytes.data(), bytes.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
  }
  /// `count` bytes, or fewer when the server closes before.
  Bytes Receive(std::size_t count) {
    Bytes bytes(count);
    std::size_t got = 0;
    while (got < count) {
      pollfd ready{socket_.Get(), POLLIN, 0};
      if (poll(&ready, 1, kGuardMs) != 1) throw std::runtime_error("the server neither answers nor closes");
      const ssize_t n = recv(socket_.Get(), bytes.data() + got, count - got, 0);
      if (n <= 0) break;
      got += static_cast<std::size_t>(n);
    }
    bytes.resize(got);
    return bytes;
  }
  /// Waits until the server closes; true when it sent nothing before.
  bool IsClosedInSilence() { return Receive(1).empty(); }
  void EndSending() { shutdown(socket_.Get(), SHUT_WR); }
  [[nodiscard]] int Socket() const { return socket_.Get(); }

 private:
  FileDescriptor socket_;
};

struct FreeModbus {
  void operator()(modbus_t* master) const {
    modbus_close(master);
    modbus_free(master);
  }
};
using Master = std::unique_ptr<modbus_t, FreeModbus>;

inline Master Connect(std::uint16_t port, int unit = 3) {
  Master master(modbus_new_tcp("127.0.0.1", port));
  modbus_set_slave(master.get(), unit);
  modbus_set_response_timeout(master.get(), kGuardMs / 1000, 0);
  if (modbus_connect(master.get()) != 0) throw std::runtime_error("libmodbus cannot connect");
  return master;
}

/// Reads one register; throws libmodbus' words.
inline std::uint16_t ReadOne(modbus_t* master, int address) {
  std::uint16_t word = 0;
  if (modbus_read_registers(master, address, 1, &word) != 1) throw std::runtime_error(modbus_strerror(errno));
  return word;
}

}  // namespace granary::test
