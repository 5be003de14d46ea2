// granaryctl registers: the Modbus map, from the table that the server encodes from.
#include <CLI/CLI.hpp>

#include <iostream>
#include <memory>
#include <string>

#include "daemon/ctl/command.h"
#include "daemon/ctl/registers.h"

namespace granary {

void AddRegisters(CLI::App& app, const GlobalOptions& global, Command& chosen) {
  const auto format = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand("registers", "print the Modbus register map");
  command->add_option("--format", *format, "text unless given; telegraf, node-red and ignition poll unit 1, or --bin")
      ->check(CLI::IsMember(RegisterFormats()));
  command->callback([=, &global, &chosen] {
    chosen = [=, &global] {
      if (global.json && !format->empty() && *format != "json")
        throw UsageError("--format " + *format + ": --json prints JSON");
      return RunRegisters(global.json       ? "json"
                          : format->empty() ? "text"
                                            : *format,
                          std::cout, std::cerr, global.bin.value_or(1));
    };
  });
}

}  // namespace granary
