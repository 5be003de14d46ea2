// granaryctl modbus poll|watch: reads one's own server as any SCADA system would.
#include <CLI/CLI.hpp>

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "daemon/ctl/command.h"
#include "daemon/ctl/modbus_poll.h"
#include "daemon/ctl/modbus_reading.h"
#include "daemon/ctl/modbus_target.h"
#include "daemon/ctl/modbus_watch.h"
#include "daemon/record_json.h"

namespace granary {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kHeartbeatWait{1500};  // it counts once a second

struct PollArguments {
  TargetArguments target;
  std::string block = "summary";
  bool check = false;
};

struct WatchArguments {
  TargetArguments target;
  double every_s = 1;
  std::uint64_t count = 0;
};

UtcTime Now() { return UtcTime(std::chrono::system_clock::now()); }

/// Whether the heartbeat is another one a little later.
bool HeartbeatCounts(ModbusClient& client, const Reading& before) {
  std::this_thread::sleep_for(kHeartbeatWait);
  return ReadBlocks(client, BlocksNamed("summary")).Of("heartbeat") != before.Of("heartbeat");
}

int Poll(const GlobalOptions& global, const PollArguments& arguments) {
  const ModbusTarget target = ChooseTarget(global, arguments.target);
  ModbusClient client = Connect(target);
  const Reading summary = ReadBlocks(client, BlocksNamed("summary"));
  const Reading reading = arguments.block == "summary" ? summary : ReadBlocks(client, BlocksNamed(arguments.block));
  std::optional<bool> counts;
  if (arguments.check) counts = HeartbeatCounts(client, summary);

  Say(PrintHostPort(target.address) + ", unit " + std::to_string(target.unit) + ", " + UtcText(Now()));
  for (const std::string& line : Verdict(summary)) Say(line);
  if (counts) Say(*counts ? "check    the heartbeat counts" : "THE HEARTBEAT STANDS STILL: nothing here is news");
  for (const std::string& line : ValueTable(reading)) Say(line);
  if (global.json) {
    nlohmann::ordered_json document{{"address", PrintHostPort(target.address)}, {"unit", target.unit}};
    document.update(ReadingToJson(summary, reading));
    document["heartbeat_counts"] = counts ? nlohmann::ordered_json(*counts) : nlohmann::ordered_json();
    PrintJson(document);
  }
  return IsOneSnapshot(summary) && counts.value_or(true) ? kExitDone : kExitFailed;
}

int Watch(const GlobalOptions& global, const WatchArguments& arguments) {
  if (global.json && arguments.count == 0) throw UsageError("--json prints one document at the end: --count is needed");
  const ModbusTarget target = ChooseTarget(global, arguments.target);
  std::vector<RegisterBlock> blocks = BlocksNamed("summary");
  for (const RegisterBlock& block : BlocksNamed("diagnostics")) blocks.push_back(block);

  auto document = nlohmann::ordered_json::array();
  const auto tell = [&](const std::string& line) {
    const std::string time = UtcText(Now());
    Say(time + "  " + line);
    document.push_back({{"utc", time}, {"line", line}});
  };
  std::optional<ModbusClient> client = Connect(target);  // a wrong address ends it here, a restart later does not
  ReadingLog log;
  std::string trouble;
  for (std::uint64_t polls = 0; arguments.count == 0 || polls < arguments.count; ++polls) {
    const auto next =
        Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(arguments.every_s));
    try {
      if (!client) client = Connect(target);
      const Reading reading = ReadBlocks(*client, blocks);
      if (!trouble.empty()) tell("the server answers again");
      trouble.clear();
      for (const std::string& line : log.Lines(reading, Clock::now())) tell(line);
    } catch (const ModbusClientError& error) {
      client.reset();
      if (trouble.empty()) tell(std::string("lost: ") + error.what() + "; trying again");
      trouble = error.what();
    }
    std::this_thread::sleep_until(next);
  }
  if (global.json) PrintJson(document);
  return trouble.empty() ? kExitDone : kExitFailed;
}

void AddPoll(CLI::App& modbus, const GlobalOptions& global, Command& chosen) {
  const auto arguments = std::make_shared<PollArguments>();
  CLI::App* command = modbus.add_subcommand("poll", "read the registers once, with names and units");
  AddTargetOptions(*command, arguments->target);
  std::vector<std::string> names{"all"};
  for (const RegisterBlock& block : RegisterBlocks()) names.emplace_back(block.name);
  command->add_option("--block", arguments->block, "part of the map")
      ->check(CLI::IsMember(names))
      ->capture_default_str();
  command->add_flag("--check", arguments->check, "read again after 1.5 s and fail when the heartbeat stands still");
  command->callback([=, &global, &chosen] { chosen = [=, &global] { return Poll(global, *arguments); }; });
}

void AddWatch(CLI::App& modbus, const GlobalOptions& global, Command& chosen) {
  const auto arguments = std::make_shared<WatchArguments>();
  CLI::App* command = modbus.add_subcommand("watch", "read on and on, one line a change");
  AddTargetOptions(*command, arguments->target);
  command->add_option("--every", arguments->every_s, "from one reading to the next")
      ->check(CLI::Range(0.05, 3600.0))
      ->type_name("SECONDS")
      ->capture_default_str();
  command->add_option("--count", arguments->count, "end after so many readings, failed ones included; 0: on Ctrl-C")
      ->capture_default_str();
  command->callback([=, &global, &chosen] { chosen = [=, &global] { return Watch(global, *arguments); }; });
}

}  // namespace

void AddModbus(CLI::App& app, const GlobalOptions& global, Command& chosen) {
  CLI::App* modbus = app.add_subcommand("modbus", "read one's own Modbus server, or have it show a made-up figure");
  modbus->require_subcommand(1);
  AddPoll(*modbus, global, chosen);
  AddWatch(*modbus, global, chosen);
  AddInject(*modbus, global, chosen);
}

}  // namespace granary
