// The local door: a Unix socket on which granaryctl asks the running daemon.
//
// One JSON object a line in, one a line out, as many as a client likes. What may be asked: daemon/local_commands.h.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <thread>

#include <nlohmann/json.hpp>

#include "daemon/modbus/socket.h"

namespace granary {

/// Where the daemon's socket stands: $RUNTIME_DIRECTORY where systemd set it, else `state_folder`.
[[nodiscard]] std::filesystem::path ControlFolder(const std::filesystem::path& state_folder);

/// FOLDER/control.sock, mode 0660: owner and group of the daemon may ask. A client that sends no whole line within 5 s
/// of its first byte, reads no answer for as long, sends more than 4096 bytes in a line or is idle for 60 s is dropped;
/// of more than 16 the one that was idle longest. FOLDER/control.lock, locked while a daemon lives, tells a socket in
/// use from one that a killed daemon left.
class ControlSocket {
 public:
  /// @param who "local uid 1000", from the kernel
  /// @return the answer; called from the socket's own thread, must return at once
  using Handler = std::function<nlohmann::json(const nlohmann::json& request, const std::string& who)>;

  /// Listens at once; the folder is created when absent. A stale socket is replaced.
  /// @throws std::runtime_error that names the file and the cause, also when a living daemon has it
  ControlSocket(const std::filesystem::path& folder, Handler handler);
  /// Ends the thread and removes the socket.
  ~ControlSocket();
  ControlSocket(const ControlSocket&) = delete;
  ControlSocket& operator=(const ControlSocket&) = delete;

 private:
  void Run(const std::stop_token& stop);

  std::filesystem::path file_;
  Handler handler_;
  FileDescriptor lock_, listener_, wake_;
  std::jthread thread_;
};

/// Sends one request to the running daemon and waits up to 10 s for its answer. The daemon is looked for in
/// $RUNTIME_DIRECTORY where that is set, then in `folder` (the state folder), then in /run/granaryd.
/// @return the answer as it came: {"ok":true,…} or {"error":"what is wrong and what is allowed"}
/// @throws std::runtime_error when no daemon listens, it may not be asked, or it gives no answer
[[nodiscard]] nlohmann::json AskDaemon(const std::filesystem::path& folder, const nlohmann::json& request);

}  // namespace granary
