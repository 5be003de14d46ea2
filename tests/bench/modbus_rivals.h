// The servers that modbus_bench compares, each a process of its own.
#pragma once

#include <cstdint>
#include <string_view>

#include <sys/types.h>

namespace granary::bench {

enum class Rival {
  kOurs,       ///< ModbusServer with one measured bin that is published again each second, as the daemon does
  kLibmodbus,  ///< the loop of libmodbus' own servers for many clients: select, modbus_receive, modbus_reply
  kFloor       ///< epoll, recv, send of fixed replies: what no server of one thread that uses them can undercut
};
[[nodiscard]] std::string_view NameOf(Rival rival);

/// Limits of our server; the others know none.
inline constexpr int kMaxClients = 128;

/// Killed at the end. To be started by a process of one thread.
class ServerProcess {
 public:
  /// @param core the one that it runs on, with real-time priority where that is permitted, whatever the rival;
  ///   negative: any, with what priority the rival asks for itself
  /// @param spinners threads of normal priority that keep cores busy beside the server, as the pipeline does
  /// @param max_clients of our server
  /// @throws std::system_error, std::runtime_error when it does not start
  ServerProcess(Rival rival, int core, int spinners = 0, int max_clients = kMaxClients);
  ~ServerProcess();
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  [[nodiscard]] std::uint16_t Port() const { return port_; }
  /// Processor time of the whole process so far, s.
  [[nodiscard]] double CpuSeconds() const;
  /// Open descriptors.
  [[nodiscard]] int Descriptors() const;
  [[nodiscard]] bool Running() const;

 private:
  pid_t pid_ = -1;
  std::uint16_t port_ = 0;
};

/// Binds the calling thread, and those that it starts, to one core. @throws std::system_error
void PinTo(int core);
/// Real-time priority for the calling thread and those that it starts. @return false where that is not permitted
bool GoFirst();
/// Ends the calling process when its parent does.
void DieWithParent();

}  // namespace granary::bench
