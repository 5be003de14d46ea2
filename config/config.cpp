// Text to tree (toml++), tree to values (the table of keys), then what only files and the whole can tell. Every step
// notes its faults in one Reader; only the end throws.
#include "config/config.h"

#include <fstream>
#include <iterator>
#include <system_error>
#include <utility>

#include "config/keys.h"

namespace granary {
namespace {

std::string AllTexts(const std::vector<ConfigFault>& faults) {
  std::vector<std::string> texts;
  for (const auto& fault : faults) texts.push_back(fault.Text());
  return Join(texts, "\n");
}

/// The file as toml++ reads it. Its grammar stops at the first error, so this one fault stands alone.
toml::table ParseTree(std::string_view text, const std::string& file) {
  try {
    return toml::parse(text, file);
  } catch (const toml::parse_error& error) {
    const auto at = error.source().begin;
    throw ConfigError({{file, static_cast<int>(at.line), "(syntax)",
                        "column " + std::to_string(at.column) + ": " + std::string(error.description())}});
  }
}

/// Notes each rig's file that does not exist.
void NoteMissingFiles(const Config& config, const Node& root) {
  for (std::size_t b = 0; b < config.bins.size(); ++b) {
    for (std::size_t r = 0; r < config.bins[b].rigs.size(); ++r) {
      const RigOptions& rig = config.bins[b].rigs[r];
      const std::string prefix = "bin[" + std::to_string(b) + "].rig[" + std::to_string(r) + "].";
      for (const auto& [key, path] : {std::pair{"calibration", rig.calibration}, std::pair{"pose", rig.pose}}) {
        std::error_code error;
        if (path.empty() || std::filesystem::is_regular_file(path, error)) continue;
        NoteFault(prefix + key + ": " + path.string() + " does not exist; must be an existing file", root);
      }
    }
  }
}

enum class Files { kMayBeMissing, kMustExist };

Config Parse(std::string_view text, const std::filesystem::path& file, Files files) {
  const toml::table tree = ParseTree(text, file.string());
  Config config;
  config.file = std::filesystem::absolute(file).lexically_normal();
  Reader reader(file.string(), config.file.parent_path());
  const Node root{tree, "", "a table", reader};
  ReadSection(root, ConfigSection(), config);
  if (files == Files::kMustExist) NoteMissingFiles(config, root);
  if (auto faults = reader.Faults(); !faults.empty()) throw ConfigError(std::move(faults));
  return config;
}

}  // namespace

std::string ConfigFault::Text() const { return file + ":" + std::to_string(line) + ": " + key + ": " + message; }

ConfigError::ConfigError(std::vector<ConfigFault> faults)
    : std::runtime_error(AllTexts(faults)), faults_(std::move(faults)) {}

Config LoadConfig(const std::filesystem::path& file) {
  const auto unreadable = [&](const std::string& why) {
    return ConfigError({{file.string(), 0, "(file)", why + "; must be a readable TOML file"}});
  };
  std::error_code error;
  if (!std::filesystem::exists(file, error)) throw unreadable("does not exist");
  if (!std::filesystem::is_regular_file(file, error)) throw unreadable("is no regular file");
  std::ifstream stream(file, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  if (!stream) throw unreadable("cannot be read");
  return Parse(text, file, Files::kMustExist);
}

Config ParseConfig(std::string_view toml, const std::filesystem::path& file) {
  return Parse(toml, file, Files::kMayBeMissing);
}

}  // namespace granary
