// The daemon's front door: arguments in, exit code out. 0 done, 1 failed, 2 bad usage, 78 bad configuration (EX_CONFIG;
// the unit does not restart on it).
#include <CLI/CLI.hpp>

#include <cstdint>
#include <exception>
#include <filesystem>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

#include "config/config.h"
#include "daemon/assembly.h"
#include "daemon/clock.h"
#include "daemon/inherited_sockets.h"
#include "daemon/log.h"
#include "daemon/record_json.h"
#include "daemon/records.h"
#include "daemon/service.h"
#include "daemon/store.h"
#include "drivers/rig.h"
#include "pipeline/large_pages.h"

namespace {

constexpr int kDone = 0;
constexpr int kFailed = 1;
constexpr int kBadUsage = 2;
constexpr int kBadConfiguration = 78;

int CheckConfig(const std::filesystem::path& file) {
  try {
    static_cast<void>(granary::LoadConfig(file));
  } catch (const granary::ConfigError& error) {
    std::cout << error.what() << '\n';
    return kFailed;
  }
  std::cout << file.string() << ": ok\n";
  return kDone;
}

/// The configuration as the service wants it; reads the file anew at each call.
granary::ServicePlan LoadPlan(const std::filesystem::path& file, const std::filesystem::path& state_folder) {
  granary::Config config = granary::LoadConfig(file);
  granary::ServicePlan plan;
  plan.site_name = config.site_name;
  plan.log_level = config.log_level;
  plan.modbus = config.modbus;
  plan.assemble = [config = std::move(config), state_folder] {
    const std::string text = granary::PrintConfig(config);
    std::vector<granary::BinSetup> setups;
    for (const auto& bin : config.bins) {
      setups.push_back(granary::AssembleBin(bin, state_folder, granary::OpenRig, text));
      setups.back().format = config.modbus.format;
    }
    return setups;
  };
  return plan;
}

int Serve(const std::filesystem::path& file, std::uint64_t cycles) {
  granary::BlockSignals();
  granary::SetUpLog();
  granary::SystemClock clock;
  granary::Records records(granary::StateFolder(), clock);
  granary::ServiceOptions options;
  options.version = GRANARY_VERSION;
  options.listeners = granary::InheritedListeners();
  options.cycles = cycles;
  options.load = [&] { return LoadPlan(file, records.folder()); };
  granary::Service service(std::move(options), records, clock, granary::OpenRig);
  const auto last = service.Run();
  if (cycles == 0) return kDone;

  bool all_valid = true;
  for (const auto& snapshot : last) {
    if (snapshot.last) std::cout << granary::RecordLine(*snapshot.last) << '\n';
    all_valid = all_valid && snapshot.last && snapshot.last->valid;
  }
  return all_valid ? kDone : kFailed;
}

}  // namespace

int main(int argc, char** argv) {
  granary::UseLargePagesForPictures();
  CLI::App app("Measures the grain in the configured bins on schedule and serves the figures over Modbus.", "granaryd");
  std::filesystem::path file = "/etc/granaryd/granaryd.toml";
  bool check = false, print = false;
  std::uint64_t cycles = 0;
  app.add_option("-c,--config", file, "configuration file")->capture_default_str();
  app.add_flag("--check-config", check, "check the configuration, print every fault, exit 0 or 1");
  app.add_flag("--print-config", print, "print the effective configuration, defaults included");
  app.add_option("--cycles", cycles, "end after N cycles of every bin and print the last record as JSON")
      ->check(CLI::PositiveNumber);
  app.set_version_flag("--version", std::string("granaryd " GRANARY_VERSION));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kDone : kBadUsage;
  }
  try {
    if (check) return CheckConfig(file);
    if (print) {
      std::cout << granary::PrintConfig(granary::LoadConfig(file));
      return kDone;
    }
    return Serve(file, cycles);
  } catch (const granary::ConfigError& error) {
    granary::PrintFatal("the configuration cannot be used:\n" + std::string(error.what()));
    return print ? kFailed : kBadConfiguration;
  } catch (const std::exception& error) {
    granary::PrintFatal(error.what());
    return kFailed;
  }
}
