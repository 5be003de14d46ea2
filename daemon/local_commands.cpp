// Every key is checked, and an unknown one refused: a misspelt figure must not be left out in silence.
#include "daemon/local_commands.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string_view>

#include "daemon/bin_state.h"
#include "daemon/record_json.h"
#include "pipeline/types/reason.h"

namespace granary {
namespace {

using Json = nlohmann::json;

constexpr std::array<std::string_view, 5> kCommandNames{"none", "measure", "acknowledge", "inhibit", "release"};
constexpr std::array<std::string_view, 4> kResultNames{"idle", "busy", "done", "rejected"};

std::string NameOf(BinCommand command) { return std::string(kCommandNames.at(static_cast<std::size_t>(command))); }
std::string NameOf(CommandResult result) { return std::string(kResultNames.at(static_cast<std::size_t>(result))); }

Json Status(const BinMonitor& bin) {
  const BinSnapshot s = bin.Published();
  Json book = Json::parse(BookToJson(s.book.in_force).dump());
  book["writable"] = s.book.writable;
  book["commit"] = NameOf(s.book.commit);
  return {{"ok", true},
          {"bin", s.bin.id},
          {"name", s.bin.name},
          {"command", NameOf(s.command.command)},
          {"result", NameOf(s.command.result)},
          {"maintenance", s.maintenance},
          {"measuring", s.measuring},
          {"injected", s.injected},
          {"abnormal_latched", s.abnormal_latched},
          {"sequence", SequenceOf(s)},
          {"next_at", s.next_at ? Json(UtcText(*s.next_at)) : Json(nullptr)},
          {"book", book},
          {"format", Json::parse(FormatToJson(s.format).dump())}};
}

/// @throws std::invalid_argument for a key that is not in `allowed`
void CheckKeys(const Json& request, const std::vector<std::string_view>& allowed) {
  for (const auto& [key, value] : request.items()) {
    if (std::find(allowed.begin(), allowed.end(), key) != allowed.end()) continue;
    std::string words;
    for (const auto& name : allowed) words += (words.empty() ? "" : ", ") + std::string(name);
    throw std::invalid_argument(key + ": is unknown; allowed are " + words);
  }
}

BinMonitor& ChosenBin(const Json& request, const std::vector<BinMonitor*>& bins) {
  if (bins.empty()) throw std::invalid_argument("bin: the daemon is not ready yet");
  const auto id = request.find("bin");
  if (id == request.end() && bins.size() == 1) return *bins.front();
  std::string ids;
  for (BinMonitor* const bin : bins) {
    if (id != request.end() && *id == bin->setup().bin.id) return *bin;
    ids += (ids.empty() ? "" : ", ") + std::to_string(bin->setup().bin.id);
  }
  throw std::invalid_argument("bin: is " + (id == request.end() ? "missing" : id->dump()) + ", must be one of " + ids);
}

std::optional<double> Number(const Json& request, const char* key) {
  const auto value = request.find(key);
  if (value == request.end() || value->is_null()) return std::nullopt;
  if (!value->is_number()) throw std::invalid_argument(key + (": is " + value->dump()) + ", must be a number");
  return value->get<double>();
}

Reason ReasonOf(const Json& request) {
  const auto value = request.find("reason");
  if (value == request.end() || value->is_null()) return Reason::kOk;
  std::string names;
  for (const ReasonInfo& info : ReasonTable()) {
    if (*value == info.name) return info.reason;
    names += (names.empty() ? "" : ", ") + std::string(info.name);
  }
  throw std::invalid_argument("reason: is " + value->dump() + ", must be one of " + names);
}

std::chrono::seconds SecondsOf(const Json& request) {
  const std::optional<double> seconds = Number(request, "seconds");
  if (!seconds || *seconds < 0 || *seconds > 86400 || *seconds != std::floor(*seconds)) {
    throw std::invalid_argument("seconds: is " + (seconds ? request["seconds"].dump() : "missing") +
                                ", must be a whole number, 1 to 86400, or 0 to end the made-up figure");
  }
  return std::chrono::seconds{static_cast<std::int64_t>(*seconds)};
}

Json Inject(const Json& request, const std::string& who, BinMonitor& bin) {
  CheckKeys(request, {"command", "bin", "seconds", "volume_m3", "error_rate_percent", "level_mean_m", "temperature_c",
                      "reason"});
  const std::chrono::seconds duration = SecondsOf(request);
  if (duration == duration.zero()) {
    bin.EndInjection(who);  // one that is over already is as well
    return Status(bin);
  }
  const Injection injection{.volume_m3 = Number(request, "volume_m3"),
                            .error_rate_percent = Number(request, "error_rate_percent"),
                            .level_mean_m = Number(request, "level_mean_m"),
                            .temperature_c = Number(request, "temperature_c"),
                            .reason = ReasonOf(request)};
  const auto faults = bin.Inject(injection, duration, who);
  if (faults.empty()) return Status(bin);
  std::string words;
  for (const auto& fault : faults) words += (words.empty() ? "" : "; ") + fault;
  return {{"error", words}};
}

Json Ask(BinCommand command, const Json& request, const std::string& who, BinMonitor& bin) {
  CheckKeys(request, {"command", "bin"});
  const std::string name = "bin " + std::to_string(bin.setup().bin.id);
  if (!bin.Ask(command, who)) {
    const CommandState state = bin.Published().command;
    return {{"error", name + ": not now: " +
                          (state.result == CommandResult::kBusy
                               ? NameOf(state.command) + " is still busy"
                               : std::string("it is not ready, or too much waits for its disk"))}};
  }
  Json status = Status(bin);
  if (command == BinCommand::kMeasure && status["result"] == "rejected") {
    return {{"error", name + ": measure is rejected: the bin is inhibited; release it first"}};
  }
  return status;
}

}  // namespace

nlohmann::json AnswerLocal(const nlohmann::json& request, const std::string& who,
                           const std::vector<BinMonitor*>& bins) {
  try {
    if (!request.is_object()) throw std::invalid_argument("the request must be a JSON object");
    const std::string command = request.value("command", Json()).is_string() ? request["command"] : Json("");
    if (command == "status") {
      CheckKeys(request, {"command", "bin"});
      return Status(ChosenBin(request, bins));
    }
    if (command == "inject") return Inject(request, who, ChosenBin(request, bins));
    const auto found = std::find(kCommandNames.begin() + 1, kCommandNames.end(), command);
    if (found != kCommandNames.end()) {
      return Ask(static_cast<BinCommand>(found - kCommandNames.begin()), request, who, ChosenBin(request, bins));
    }
    throw std::invalid_argument("command: is " + (request.contains("command") ? request["command"].dump() : "missing") +
                                ", must be inject, measure, acknowledge, inhibit, release or status");
  } catch (const std::invalid_argument& error) {
    return {{"error", error.what()}};
  }
}

}  // namespace granary
