// One connection to a PLC's Modbus TCP server.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <vector>

#include <modbus/modbus.h>

#include "daemon/modbus/socket.h"
#include "daemon/options.h"

namespace granary {

/// The PLC has answered, and the answer is no. The connection is as good as before.
class PlcRefusal : public std::runtime_error {
 public:
  PlcRefusal(const std::string& what, bool lasting) : std::runtime_error(what), lasting_(lasting) {}
  /// Until somebody changes a configuration: function, address or value are not the PLC's.
  [[nodiscard]] bool lasting() const { return lasting_; }

 private:
  bool lasting_;
};

/// The connection cannot be made, or not be used any more: whose answer the next one would be is not known.
class PlcLinkError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Connected from construction to destruction. Used by one thread, which blocks in every method, for `timeout` at most
/// or until `stop` is requested; the constructor may take twice as long when the host is a name.
class PlcLink {
 public:
  /// @throws PlcLinkError, std::system_error when the machine has no socket left
  PlcLink(const HostPort& plc, int unit, std::chrono::milliseconds timeout, const std::stop_token& stop);

  /// Writes 1…123 holding registers (FC16). @throws PlcRefusal, PlcLinkError; which registers were asked for is said
  void Write(int address, std::span<const std::uint16_t> words);
  /// Reads 1…125 holding registers (FC3). @throws PlcRefusal, PlcLinkError
  [[nodiscard]] std::vector<std::uint16_t> Read(int address, int count);
  /// Whether the PLC has closed the connection since the last answer, as many do with idle ones. Does not block.
  /// @throws PlcLinkError when it has sent what nobody asked for
  [[nodiscard]] bool WasClosed() const;

 private:
  struct FreeContext {
    void operator()(modbus_t* context) const { modbus_free(context); }
  };
  [[noreturn]] void Fail(int error, const char* verb, int address, int count) const;

  std::chrono::milliseconds timeout_;
  FileDescriptor socket_;  ///< ours, not the context's: modbus_free leaves it open
  std::unique_ptr<modbus_t, FreeContext> context_;
  std::stop_callback<std::function<void()>> interrupt_;  // after the socket that it shuts down
};

}  // namespace granary
