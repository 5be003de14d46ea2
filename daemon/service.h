// The process as systemd sees it: starts, reloads, supervises and ends the workers and the servers.
#pragma once

#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "daemon/bin_monitor.h"
#include "daemon/clock.h"
#include "daemon/control_socket.h"
#include "daemon/modbus/socket.h"
#include "daemon/options.h"
#include "daemon/records.h"
#include "daemon/rig_slot.h"

namespace granary {

/// Holds SIGTERM, SIGINT and SIGHUP back for the service's loop. To be called first in main: threads inherit it.
void BlockSignals();

/// One configuration, read and checked.
struct ServicePlan {
  std::string site_name;
  std::string log_level = "info";
  ModbusOptions modbus;
  /// Reads what the bins need; their `prepare` is the slow rest. Throws as AssembleBin does.
  std::function<std::vector<BinSetup>()> assemble;
};

struct ServiceOptions {
  std::string version;
  std::vector<FileDescriptor> listeners;  ///< sockets that systemd opened; each must be one that the plan asks for
  std::uint64_t cycles = 0;               ///< end by itself after so many of every bin; 0: never
  std::function<ServicePlan()> load;      ///< reads the configuration; throws with everything that is wrong with it
};

/// Everything is called from the main thread.
class Service {
 public:
  /// @param records, clock borrowed
  Service(ServiceOptions options, Records& records, Clock& clock, RigOpener open);
  ~Service();

  /// Starts, and returns when a signal or the end of the cycles ends the service: workers joined, projectors off.
  /// SIGHUP reads the configuration anew and swaps it whole; with any fault in it the old one keeps running.
  /// @return the last snapshot of every bin
  /// @throws whatever `load`, `assemble` and the server throw at the start
  std::vector<BinSnapshot> Run();

 private:
  struct Running;

  [[nodiscard]] std::unique_ptr<Running> Build(const Running* before);
  void Begin(Running& next, Running* before);
  void OpenControlSocket();
  void BeginReload();
  void EndReload();
  void Tick();
  [[nodiscard]] std::vector<BinSnapshot> Snapshots() const;

  ServiceOptions options_;
  Records& records_;
  Clock& clock_;
  RigOpener open_;
  FileDescriptor signals_, wake_;
  bool progress_ = true;
  std::mutex swap_;  // held while `running_` changes, and by the local socket while it uses it
  std::unique_ptr<Running> running_;
  std::unique_ptr<ControlSocket> control_socket_;  // after `running_`: its thread uses it
  bool reload_again_ = false;
  std::future<std::unique_ptr<Running>> reloading_;  // last: its thread uses what stands above
};

}  // namespace granary
