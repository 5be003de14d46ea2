// Where a fault stands: a check names a key, this finds its line.
#include "config/section.h"

#include <string_view>

namespace granary {
namespace {

/// The node that a fault named "left.id" or "exclude_m[1]" is about: the deepest part of `path` that the file has.
/// `found` says whether it is the whole path. A pointer, because g++ 14 takes the reference for one into `path`.
const toml::node* Locate(const toml::node& table, std::string path, bool& found) {
  found = true;
  while (!path.empty()) {
    if (const auto view = toml::at_path(table, path)) return view.node();
    found = false;
    const auto cut = path.find_last_of(".[");
    path.resize(cut == std::string::npos ? 0 : cut);
  }
  return &table;
}

/// What is wrong, for a check that only says what is allowed.
std::string WithValue(const std::string& words, const toml::node& node) {
  return node.is_value() && words.starts_with("must ") ? "is " + Describe(node) + "; " + words : words;
}

}  // namespace

void NoteFault(const std::string& fault, const Node& table) {
  const auto colon = fault.find(": ");
  const std::string path = fault.substr(0, colon);
  const std::string key = table.key.empty() ? path : table.key + "." + path;
  if (table.reader.HasFault(key)) return;
  bool found = false;
  const toml::node& node = *Locate(table.toml, path, found);
  const std::string words = fault.substr(colon + 2);
  const Node where{node, key, {}, table.reader};
  where.Fault(found ? WithValue(words, node) : words);
}

void NoteFaults(const std::vector<std::string>& faults, const Node& table, bool parts_read) {
  for (const auto& fault : faults) {
    const std::string path = fault.substr(0, fault.find(": "));
    const auto dot = path.rfind('.');
    const bool compares_parts = dot != std::string::npos;
    // A left.driver that could not be read is no evidence against right.driver.
    if (compares_parts && (!parts_read || table.reader.HasFaultNamed(table.key, path.substr(dot + 1)))) continue;
    NoteFault(fault, table);
  }
}

void NoteUnknownKey(const Node& table, const toml::key& key, const std::vector<std::string>& allowed) {
  const std::string nearest = Nearest(key.str(), allowed);
  table.reader.Fault(static_cast<int>(key.source().begin.line), Below(table.key, std::string(key.str())),
                     "is no key here" + (nearest.empty() ? std::string() : "; did you mean " + nearest + "?") +
                         "; allowed: " + Join(allowed));
}

}  // namespace granary
