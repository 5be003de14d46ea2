// granaryctl modbus inject, alarm ack, inhibit, release: what the running daemon is asked over its local socket.
#include <CLI/CLI.hpp>

#include <chrono>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>

#include "config/values.h"
#include "daemon/control_socket.h"
#include "daemon/ctl/command.h"
#include "daemon/record_json.h"
#include "daemon/store.h"

namespace granary {
namespace {

constexpr std::chrono::seconds kPatience{300};

struct InjectArguments {
  std::optional<double> volume_m3, error_rate_percent, level_mean_m, temperature_c;
  std::string reason;
  std::string duration = "60s";
  bool end = false;
};

/// The daemon's answer. @throws std::runtime_error with the daemon's words when it refuses
nlohmann::json Ask(const GlobalOptions& global, nlohmann::json request) {
  if (global.bin) request["bin"] = *global.bin;
  nlohmann::json answer = AskDaemon(StateFolder(), request);
  if (answer.contains("error")) throw std::runtime_error(answer["error"].get<std::string>());
  return answer;
}

/// ", bin 3", or nothing where the daemon has but one and nobody named it.
std::string OfBin(const GlobalOptions& global) {
  return global.bin ? ", bin " + std::to_string(*global.bin) : std::string();
}

nlohmann::json InjectRequest(const InjectArguments& arguments) {
  const bool gives = arguments.volume_m3 || arguments.error_rate_percent || arguments.level_mean_m ||
                     arguments.temperature_c || !arguments.reason.empty();
  if (arguments.end) {
    if (gives) throw UsageError("--end goes with no figure");
    return {{"command", "inject"}, {"seconds", 0}};
  }
  if (!gives) throw UsageError("nothing to inject: --volume, --error-rate, --level, --temperature, --reason, or --end");
  const auto duration = ParseDuration(arguments.duration);
  if (!duration || *duration < std::chrono::seconds(1) || duration->count() % 1000 != 0)
    throw UsageError("--for " + arguments.duration + ": must be whole seconds, at least 1, e.g. 60s or 5min");
  nlohmann::json request{{"command", "inject"}, {"seconds", duration->count() / 1000}};
  const auto put = [&](const char* key, const std::optional<double>& value) {
    if (value) request[key] = *value;
  };
  put("volume_m3", arguments.volume_m3);
  put("error_rate_percent", arguments.error_rate_percent);
  put("level_mean_m", arguments.level_mean_m);
  put("temperature_c", arguments.temperature_c);
  if (!arguments.reason.empty()) request["reason"] = arguments.reason;
  return request;
}

int Inject(const GlobalOptions& global, const InjectArguments& arguments) {
  const nlohmann::json request = InjectRequest(arguments);
  const nlohmann::json answer = Ask(global, request);
  if (arguments.end) {
    Say("the made-up figure is gone, the true one is published again" + OfBin(global));
  } else {
    const auto until = UtcTime(std::chrono::system_clock::now()) + std::chrono::seconds(request["seconds"].get<int>());
    Say("a made-up figure is published until " + UtcText(until) + OfBin(global) +
        "; its status bit simulated is on, and nothing of it is stored");
    Say("to end it before: granaryctl modbus inject --end" +
        (global.bin ? " --bin " + std::to_string(*global.bin) : std::string()));
  }
  if (global.json) PrintJson(answer);
  return kExitDone;
}

bool IsBusy(const nlohmann::json& state) { return state.value("result", "") == "busy"; }

/// The bin's state once no command is busy. @param state as it was asked last
nlohmann::json WaitWhileBusy(const GlobalOptions& global, nlohmann::json state) {
  if (IsBusy(state)) Say("waiting for " + state.value("command", "a command") + OfBin(global));
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  while (IsBusy(state)) {
    if (std::chrono::steady_clock::now() > give_up) {
      throw std::runtime_error(state.value("command", "a command") + " is still busy after " +
                               std::to_string(kPatience.count()) + " s; look at the daemon's log");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    state = Ask(global, {{"command", "status"}});
  }
  return state;
}

/// Asks for a command of register 910 once the one before is done, and waits until it is done itself: who inhibits a
/// bin wants to know that it is dark.
int Tell(const GlobalOptions& global, const std::string& command, const std::string& done) {
  (void)WaitWhileBusy(global, Ask(global, {{"command", "status"}}));
  const nlohmann::json answer = WaitWhileBusy(global, Ask(global, {{"command", command}}));
  if (answer.value("command", "") != command)
    throw std::runtime_error(command + ": another client has asked for " + answer.value("command", "something else") +
                             " meanwhile; look at granaryctl modbus poll");
  if (answer.value("result", "") == "rejected")
    throw std::runtime_error(command + " was rejected; the daemon's log says why");
  Say(done + OfBin(global));
  if (global.json) PrintJson(answer);
  return kExitDone;
}

void AddTell(CLI::App& app, const GlobalOptions& global, Command& chosen, const std::string& name,
             const std::string& about, const std::string& command, const std::string& done) {
  app.add_subcommand(name, about)->callback([=, &global, &chosen] {
    chosen = [=, &global] { return Tell(global, command, done); };
  });
}

}  // namespace

void AddInject(CLI::App& modbus, const GlobalOptions& global, Command& chosen) {
  const auto arguments = std::make_shared<InjectArguments>();
  CLI::App* command = modbus.add_subcommand(
      "inject", "publish a made-up figure for a while, marked as simulated: the loop test with the PLC");
  command->add_option("--volume", arguments->volume_m3, "volume")->type_name("M3");
  command->add_option("--error-rate", arguments->error_rate_percent, "error rate")->type_name("PERCENT");
  command->add_option("--level", arguments->level_mean_m, "mean level")->type_name("M");
  command->add_option("--temperature", arguments->temperature_c, "temperature of the rig")->type_name("C");
  command->add_option("--reason", arguments->reason, "name of the reason for which the cycle failed")
      ->type_name("NAME");
  command->add_option("--for", arguments->duration, "how long")->type_name("DURATION")->capture_default_str();
  command->add_flag("--end", arguments->end, "publish the true figure again");
  command->callback([=, &global, &chosen] { chosen = [=, &global] { return Inject(global, *arguments); }; });
}

void AddControl(CLI::App& app, const GlobalOptions& global, Command& chosen) {
  CLI::App* alarm = app.add_subcommand("alarm", "alarms of the running daemon");
  alarm->require_subcommand(1);
  AddTell(*alarm, global, chosen, "ack", "acknowledge: latched alarms go off", "acknowledge", "alarms acknowledged");
  AddTell(app, global, chosen, "inhibit", "no projector and no camera until released, also after a restart", "inhibit",
          "inhibited");
  AddTell(app, global, chosen, "release", "measure again after inhibit", "release", "released");
}

}  // namespace granary
