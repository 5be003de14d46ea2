// Nothing of the manual's tables is written by hand: names, types and meanings are the rows', defaults are those of a
// default-made struct, and what is allowed is what the checks say of an impossible value.
#include "config/reference.h"

#include <algorithm>

#include "config/keys.h"

namespace granary {
namespace {

constexpr const char* kPreface =
    R"(<!-- Made by granary_config_reference from the table of keys in config/keys_*.cpp. Do not edit. -->
# Configuration

`granaryd` and `granaryctl` read one TOML file, `/etc/granaryd/granaryd.toml` unless `--config FILE` says otherwise.
`config/granaryd.toml` is an example with every key, `config/demo.toml` the simulated bin of `./demo`,
`config/examples/replay.toml` a bin measured from stored frames.

- `granaryd --config FILE --check-config` reads the file, prints **every** fault as `FILE:LINE: key: what is wrong, what
  is allowed` and exits with 1, or with 0 when there is none. `--print-config` prints the effective configuration,
  defaults included; what it prints is a configuration file itself.
- A key that is not on this page is an error. So is a value of the wrong type or out of range: nothing is clipped.
- Lengths are metres and end in `_m`. Durations are strings with a unit, `"250ms"`, `"10s"`, `"30min"`, `"1h"`, `"2d"`;
  keys that end in a unit (`exposure_us`, `max_on_ms`) are plain numbers.
- Relative paths start at the folder of the configuration file. A calibration or pose file that does not exist is a fault.
- In the tables below, *required* stands for a key without a default, and — for a key that is unset by default.
)";

std::string Cell(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '|') out += '\\';
    out += c;
  }
  return out;
}

std::string Code(const std::string& text) { return text.empty() ? "—" : "`" + Cell(text) + "`"; }

/// [bin.rig.sim], [[bin.rig]]: as the header stands in the file.
std::string Header(const SectionWords& section) {
  if (section.path.empty()) return "Top level";
  if (section.kind == TableKind::kArray) return "`[[" + section.path + "]]`";
  if (section.kind == TableKind::kInline) {
    const auto dot = section.path.rfind('.');
    return "`" + section.path.substr(dot + 1) + " = { … }` in `" + section.path.substr(0, dot) + "`";
  }
  return "`[" + section.path + "]`";
}

std::string Row(const KeyWords& key) {
  const std::string type = key.unit.empty() ? key.type : key.type + ", " + key.unit;
  const std::string preset = key.required ? "*required*" : Code(key.default_value);
  return "| `" + key.name + "` | " + Cell(type) + " | " + preset + " | " +
         (key.is_table ? "a table further down" : Cell(key.allowed)) + " | " + Cell(key.meaning) + " |\n";
}

}  // namespace

std::vector<SectionWords> DescribeConfig() {
  std::vector<SectionWords> sections;
  DescribeSection(ConfigSection(), {"", "The whole file.", TableKind::kHeader}, sections);
  return sections;
}

std::string ConfigReference() {
  std::string out = kPreface;
  for (const auto& section : DescribeConfig()) {
    out += "\n## " + Header(section) + "\n" + section.meaning;
    if (!section.same_as.empty()) {
      out += " The same keys as `" + section.same_as + "`.\n";
      continue;
    }
    out += "\n\n| key | type, unit | default | allowed | meaning |\n| --- | --- | --- | --- | --- |\n";
    for (const auto& key : section.keys) out += Row(key);
  }
  return out;
}

std::vector<std::string> KnownKeys() {
  const auto sections = DescribeConfig();
  std::vector<std::string> keys;
  for (const auto& section : sections) {
    const auto told = std::find_if(sections.begin(), sections.end(), [&](const auto& other) {
      return other.path == (section.same_as.empty() ? section.path : section.same_as);
    });
    for (const auto& key : told->keys) keys.push_back(Below(section.path, key.name));
  }
  return keys;
}

}  // namespace granary
