// The configuration is read only for what the arguments leave open, so that any server can be looked at from anywhere.
#include "daemon/ctl/modbus_target.h"

#include <CLI/CLI.hpp>

#include <string>

#include "config/config.h"

namespace granary {
namespace {

int BinIdOf(const Config& config) {
  if (config.bins.size() == 1) return config.bins.front().bin.id;
  std::string known;
  for (const BinConfig& bin : config.bins) known += (known.empty() ? "" : ", ") + std::to_string(bin.bin.id);
  throw UsageError("--bin is needed: " + config.file.string() + " has the bins " + known);
}

}  // namespace

void AddTargetOptions(CLI::App& command, TargetArguments& arguments) {
  command.add_option("--address", arguments.address, "of the server; otherwise modbus.tcp.listen of the configuration")
      ->type_name("HOST:PORT");
  command.add_option("--unit", arguments.unit, "unit id; otherwise the bin's")->check(CLI::Range(0, 255));
}

ModbusTarget ChooseTarget(const GlobalOptions& global, const TargetArguments& arguments) {
  ModbusTarget target;
  if (!arguments.address.empty()) {
    const auto address = ParseHostPort(arguments.address);
    if (!address) {
      throw UsageError("--address " + arguments.address +
                       ": must be HOST:PORT or [IPV6]:PORT, e.g. 192.168.7.10:502, port 1 to 65535");
    }
    target.address = *address;
    target.where_from = "--address";
    target.unit = arguments.unit ? *arguments.unit : global.bin ? *global.bin : BinIdOf(LoadConfig(global.config));
    return target;
  }
  const Config config = LoadConfig(global.config);
  target.address = {config.modbus.tcp.host, config.modbus.tcp.port};
  if (target.address.host == "0.0.0.0") target.address.host = "127.0.0.1";
  if (target.address.host == "::") target.address.host = "::1";
  target.where_from = "modbus.tcp.listen of " + config.file.string() + "; --address names another";
  target.unit = arguments.unit ? *arguments.unit : global.bin ? *global.bin : BinIdOf(config);
  return target;
}

ModbusClient Connect(const ModbusTarget& target) { return {target.address, target.unit, target.where_from}; }

}  // namespace granary
