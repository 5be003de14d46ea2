// What the commands of granaryctl share: the global options, how they end, where they print.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>

#include <nlohmann/json.hpp>

namespace CLI {
class App;
}

namespace granary {

inline constexpr int kExitDone = 0;
inline constexpr int kExitFailed = 1;
inline constexpr int kExitBadUsage = 2;

/// The arguments ask for what cannot be; ends the program with kExitBadUsage.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The options that every command takes, before or after its name.
struct GlobalOptions {
  std::filesystem::path config = "/etc/granaryd/granaryd.toml";
  std::optional<int> bin;
  bool json = false;  ///< one JSON document on standard output, nothing else there
};

/// What the chosen command does; returns the exit code. Throws UsageError for bad usage, any other std::exception for a
/// failure. It prints its JSON document last, so that a failure prints one document too.
using Command = std::function<int()>;

/// Each adds one subcommand to `app`; once the arguments are parsed and name it, `chosen` is what it does.
/// `global` is read when the command runs.
void AddMeasure(CLI::App& app, const GlobalOptions& global, Command& chosen);
void AddSweep(CLI::App& app, const GlobalOptions& global, Command& chosen);
void AddGrainOffset(CLI::App& app, const GlobalOptions& global, Command& chosen);
void AddReference(CLI::App& app, const GlobalOptions& global, Command& chosen);
void AddDisparity(CLI::App& app, const GlobalOptions& global, Command& chosen);
void AddCameras(CLI::App& app, const GlobalOptions& global, Command& chosen);
void AddMeter(CLI::App& app, const GlobalOptions& global, Command& chosen);
void AddSnapshot(CLI::App& app, const GlobalOptions& global, Command& chosen);
void AddHistory(CLI::App& app, const GlobalOptions& global, Command& chosen);
void AddRegisters(CLI::App& app, const GlobalOptions& global, Command& chosen);
void AddModbus(CLI::App& app, const GlobalOptions& global, Command& chosen);
void AddInject(CLI::App& modbus, const GlobalOptions& global, Command& chosen);
/// alarm, inhibit and release.
void AddControl(CLI::App& app, const GlobalOptions& global, Command& chosen);

/// Null where it is not known.
[[nodiscard]] nlohmann::ordered_json OrNull(const std::optional<double>& value);
/// Standard output, one document; bytes that are no UTF-8 are replaced.
void PrintJson(const nlohmann::ordered_json& document);
/// Progress and results for people: one line on standard error.
void Say(const std::string& line);

}  // namespace granary
