// granaryctl history: what the daemon has measured, newest last. It needs no configuration, only the state folder.
#include <CLI/CLI.hpp>

#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "daemon/ctl/command.h"
#include "daemon/record_json.h"
#include "daemon/store.h"

namespace granary {
namespace {

struct HistoryArguments {
  std::size_t last = 50;
};

/// `value` right-aligned; a dash when it is unknown.
std::string Cell(const std::optional<double>& value, int width, int decimals) {
  char text[64];
  if (value) {
    std::snprintf(text, sizeof text, "  %*.*f", width, decimals, *value);
  } else {
    std::snprintf(text, sizeof text, "  %*s", width, "-");
  }
  return text;
}

std::string Row(const Measurement& m) {
  char start[80];
  std::snprintf(start, sizeof start, "%3d  %8llu  %s", m.bin, static_cast<unsigned long long>(m.sequence),
                UtcText(m.utc).c_str());
  return start + Cell(m.volume_m3, 12, 5) + Cell(m.volume_u95_m3, 9, 5) + Cell(m.mass_kg, 12, 2) +
         Cell(m.error_rate_percent, 8, 2) + Cell(m.coverage_percent, 7, 1) + "  " + std::string(InfoOf(m.reason).name) +
         (m.simulated ? " (simulated)" : "");
}

int History(const GlobalOptions& global, const HistoryArguments& arguments) {
  const Store store(StateFolder(), Store::Access::kRead);
  const auto records = store.Last(arguments.last, global.bin);
  if (global.json) {
    auto document = nlohmann::ordered_json::array();
    for (const Measurement& record : records) document.push_back(RecordToJson(record));
    PrintJson(document);
    return kExitDone;
  }
  Say("bin  sequence  utc                      volume m3    ± u95       mass kg   error %  cover %  reason");
  for (const Measurement& record : records) Say(Row(record));
  return kExitDone;
}

}  // namespace

void AddHistory(CLI::App& app, const GlobalOptions& global, Command& chosen) {
  const auto arguments = std::make_shared<HistoryArguments>();
  CLI::App* command = app.add_subcommand("history", "the stored measurements, newest last");
  command->add_option("--last", arguments->last, "how many at the most")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->callback([=, &global, &chosen] { chosen = [=, &global] { return History(global, *arguments); }; });
}

}  // namespace granary
