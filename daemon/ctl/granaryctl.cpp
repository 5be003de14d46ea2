// The engineer's tool: arguments in, exit code out. 0 done, 1 failed, 2 bad usage.
#include <CLI/CLI.hpp>

#include <algorithm>
#include <exception>
#include <iostream>
#include <memory>
#include <string>
#include <string_view>

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include "daemon/ctl/command.h"
#include "daemon/ctl/stop_signals.h"
#include "pipeline/large_pages.h"

namespace granary {
namespace {

int End(int code, const std::string& words, bool json) {
  Say("granaryctl: " + words);
  if (json) PrintJson({{"error", words}});
  return code;
}

int RunCommand(const Command& command, bool json) {
  try {
    return command();
  } catch (const UsageError& error) {
    return End(kExitBadUsage, error.what(), json);
  } catch (const std::exception& error) {
    return End(kExitFailed, error.what(), json);
  }
}

int Main(int argc, char** argv) {
  // Drivers log; standard output belongs to the JSON document.
  spdlog::set_default_logger(std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::stderr_sink_mt>()));
  spdlog::set_pattern("%l: %v");
  spdlog::set_level(spdlog::level::warn);

  CLI::App app("Measures, prepares and inspects the bins of a granary, with or without the daemon.", "granaryctl");
  GlobalOptions global;
  Command chosen;
  app.add_option("-c,--config", global.config, "configuration file")->capture_default_str();
  app.add_option("--bin", global.bin, "id of the bin; needed where there are several");
  app.add_flag("--json", global.json, "print one JSON document on standard output");
  app.set_version_flag("--version", std::string("granaryctl " GRANARY_VERSION));
  app.require_subcommand(1);
  app.fallthrough();  // the global options may also follow the command
  AddMeasure(app, global, chosen);
  AddSweep(app, global, chosen);
  AddGrainOffset(app, global, chosen);
  AddReference(app, global, chosen);
  AddDisparity(app, global, chosen);
  AddCameras(app, global, chosen);
  AddMeter(app, global, chosen);
  AddSnapshot(app, global, chosen);
  AddHistory(app, global, chosen);
  AddRegisters(app, global, chosen);
  AddModbus(app, global, chosen);
  AddControl(app, global, chosen);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // help or version, as asked
    // The parser may have stopped before it came to --json.
    const bool json =
        std::any_of(argv + 1, argv + argc, [](const char* text) { return text == std::string_view("--json"); });
    Say("Run granaryctl --help, or granaryctl COMMAND --help.");
    return End(kExitBadUsage, error.what(), json);
  }
  const int code = RunCommand(chosen, global.json);
  std::cout.flush();
  if (!std::cout) {
    Say("granaryctl: standard output cannot be written");
    return kExitFailed;
  }
  return code;
}

}  // namespace
}  // namespace granary

int main(int argc, char** argv) {
  granary::EndOnlyBetweenCaptures();
  granary::UseLargePagesForPictures();
  return granary::Main(argc, argv);
}
