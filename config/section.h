// What a table of the file is made of. One row a key; reading, checking, printing and docs/configuration.md all come
// from these rows, which stand in keys_*.cpp.
#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "config/config.h"
#include "config/reader.h"
#include "config/values.h"

namespace granary {

/// A row of the manual.
struct KeyWords {
  std::string name, type, unit, default_value, allowed, meaning;
  bool required = false;
  bool is_table = false;  ///< told further down in a table of its own
};
enum class TableKind { kHeader, kInline, kArray };

/// A table of the manual.
struct SectionWords {
  std::string path;  ///< dotted, without indices: "bin.rig.sim"
  std::string meaning;
  TableKind kind = TableKind::kHeader;
  std::string same_as = {};  ///< path of the table with the same keys, told before; then `keys` is empty
  std::vector<KeyWords> keys = {};
  const void* section = nullptr;  ///< tells equal tables
};

/// One key of the table that fills a T.
template <typename T>
struct Key {
  std::string name, type, unit, meaning;
  std::string allowed;  ///< empty: what `Section::faults` says of an impossible value, else any value
  bool required = false;
  std::function<void(const Node&, T&)> read;
  /// The value as TOML, empty when unset. Null for a key that is a table with its own header.
  std::function<std::string(const T&)> print;
  /// Appends the tables with their headers. Null for a plain value.
  std::function<void(const T&, const std::string& path, std::string& out)> print_tables;
  /// Sets a value that no range allows; null where there is none.
  std::function<void(T&)> spoil;
  /// Appends the tables below this key to the manual; null for a plain value.
  std::function<void(const std::string& path, std::vector<SectionWords>&)> describe;

  Key& Required() {
    required = true;
    return *this;
  }
  Key& Allowed(std::string words) {
    allowed = std::move(words);
    return *this;
  }
  Key& OmitEmpty() {
    print = [inner = print](const T& value) { return inner(value) == "[]" ? std::string() : inner(value); };
    return *this;
  }
};

/// The keys of one table and the check of the whole.
template <typename T>
struct Section {
  std::vector<Key<T>> keys;
  std::function<std::vector<std::string>(const T&)> faults;  ///< "key: what, what is allowed"; null: none
};

/// Notes what a check said of `table`, "key: what, what is allowed", at the line of that key; silent where a fault was
/// noted before.
void NoteFault(const std::string& fault, const Node& table);
/// Notes all that a check said. What it said of a part ("right.driver: …") by looking at other parts counts only when
/// those were read: `parts_read` is false when a part is missing altogether.
void NoteFaults(const std::vector<std::string>& faults, const Node& table, bool parts_read);
/// Notes a key that `table` does not have, with the one that was probably meant.
void NoteUnknownKey(const Node& table, const toml::key& key, const std::vector<std::string>& allowed);
[[nodiscard]] inline std::string Below(const std::string& path, const std::string& name) {
  return path.empty() ? QuoteKey(name) : path + "." + QuoteKey(name);
}

/// The words on what a key may be; from its row or from the section's own check.
template <typename T>
std::string AllowedWords(const Section<T>& section, const Key<T>& key) {
  if (!key.allowed.empty() || !key.spoil || !section.faults) return key.allowed;
  T impossible{};
  key.spoil(impossible);
  for (const auto& fault : section.faults(impossible)) {
    const bool about_key = fault.starts_with(key.name + ": ") || fault.starts_with(key.name + "[0]: ");
    const auto must = fault.find("must ");
    if (!about_key || must == std::string::npos) continue;
    const std::string words = fault.substr(must + 5);
    if (words.starts_with("be ")) return words.substr(3);
    return words.starts_with("not be ") ? "not " + words.substr(7) : words;
  }
  return {};
}

template <typename T>
void ReadSection(const Node& node, const Section<T>& section, T& out) {
  const toml::table* table = node.toml.as_table();
  if (table == nullptr) {
    node.Fault("is " + Describe(node.toml) + "; must be a table");
    return;
  }
  std::vector<std::string> names;
  for (const auto& key : section.keys) names.push_back(key.name);
  for (const auto& [name, value] : *table) {
    if (std::find(names.begin(), names.end(), name.str()) == names.end()) NoteUnknownKey(node, name, names);
  }
  for (const auto& key : section.keys) {
    const std::string allowed = AllowedWords(section, key);
    std::string wanted = key.type + (key.unit.empty() ? "" : " (" + key.unit + ")");
    if (!allowed.empty()) wanted += ": " + allowed;
    const std::string path = Below(node.key, key.name);
    if (const toml::node* value = table->get(key.name)) {
      key.read(Node{*value, path, wanted, node.reader}, out);
    } else if (key.required) {
      node.reader.Fault(node.Line(), path, "is missing; must be " + wanted);
    }
  }
  if (!section.faults) return;
  const bool parts_read = std::none_of(section.keys.begin(), section.keys.end(), [&](const auto& key) {
    return key.describe && node.reader.HasFaultAt(Below(node.key, key.name));
  });
  NoteFaults(section.faults(out), node, parts_read);
}

template <typename T>
std::string PrintValues(const T& value, const Section<T>& section, const std::string& between) {
  std::string out;
  for (const auto& key : section.keys) {
    const std::string text = key.print ? key.print(value) : std::string();
    if (!text.empty()) out += (out.empty() ? "" : between) + key.name + " = " + text;
  }
  return out;
}

/// Values first, then the tables: in TOML a value after a header belongs to that header.
template <typename T>
void PrintSection(const T& value, const Section<T>& section, const std::string& path, const std::string& header,
                  std::string& out) {
  const std::string values = PrintValues(value, section, "\n");
  if (!values.empty() || header.starts_with("[[")) {
    if (!header.empty()) out += (out.empty() ? "" : "\n") + header + "\n";
    out += values + (values.empty() ? "" : "\n");
  }
  for (const auto& key : section.keys) {
    if (key.print_tables) key.print_tables(value, Below(path, key.name), out);
  }
}

/// Appends the table `words` and the tables below it.
template <typename T>
void DescribeSection(const Section<T>& section, SectionWords words, std::vector<SectionWords>& out) {
  const std::string path = words.path;
  const auto told = std::find_if(out.begin(), out.end(), [&](const auto& other) { return other.section == &section; });
  words.section = &section;
  if (told != out.end()) {
    words.same_as = told->path;
    out.push_back(std::move(words));
    return;
  }
  const T defaults{};
  for (const auto& key : section.keys) {
    const bool has_default = !key.required && !key.describe;
    words.keys.push_back({key.name, key.type, key.unit, has_default ? key.print(defaults) : std::string(),
                          AllowedWords(section, key), key.meaning, key.required, bool(key.describe)});
  }
  out.push_back(std::move(words));
  for (const auto& key : section.keys) {
    if (key.describe) key.describe(Below(path, key.name), out);
  }
}

}  // namespace granary
