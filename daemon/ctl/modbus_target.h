// Which server and unit the modbus commands talk to, from the arguments or the configuration.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "daemon/ctl/command.h"
#include "daemon/ctl/modbus_client.h"
#include "daemon/options.h"

namespace CLI {
class App;
}

namespace granary {

/// `--address` and `--unit`.
struct TargetArguments {
  std::string address;
  std::optional<int> unit;
};
void AddTargetOptions(CLI::App& command, TargetArguments& arguments);

struct ModbusTarget {
  HostPort address;
  int unit = 0;
  std::string where_from;  ///< for people: which key or argument gave the address
};

/// What the arguments leave open comes from the configuration: the address that its server listens on (loopback where
/// that is every address), and --bin or its only bin.
/// @throws UsageError for an address that is none, or several bins and no choice; ConfigError
[[nodiscard]] ModbusTarget ChooseTarget(const GlobalOptions& global, const TargetArguments& arguments);

/// A new connection. @throws ModbusClientError
[[nodiscard]] ModbusClient Connect(const ModbusTarget& target);

}  // namespace granary
