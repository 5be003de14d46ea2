// A fault is noted, never thrown: the engineer corrects a file once, not once a fault. What could not be read keeps its
// default, and whoever looks at it later asks HasFault first, so that one slip gives one line.
#include "config/reader.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <type_traits>
#include <utility>
#include <variant>

#include "config/values.h"

namespace granary {

void Reader::Fault(int line, std::string key, std::string message) {
  faults_.push_back({file_, line, std::move(key), std::move(message)});
}

bool Reader::HasFault(std::string_view key) const {
  return std::any_of(faults_.begin(), faults_.end(), [&](const ConfigFault& fault) {
    if (!fault.key.starts_with(key)) return false;
    return fault.key.size() == key.size() || fault.key[key.size()] == '.' || fault.key[key.size()] == '[';
  });
}

bool Reader::HasFaultAt(std::string_view key) const {
  return std::any_of(faults_.begin(), faults_.end(), [&](const ConfigFault& fault) { return fault.key == key; });
}

bool Reader::HasFaultNamed(std::string_view table, std::string_view name) const {
  const std::string ending = "." + std::string(name);
  return std::any_of(faults_.begin(), faults_.end(), [&](const ConfigFault& fault) {
    return fault.key.starts_with(table) && fault.key.ends_with(ending);
  });
}

std::vector<ConfigFault> Reader::Faults() const {
  auto sorted = faults_;
  std::stable_sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) { return a.line < b.line; });
  return sorted;
}

std::string Describe(const toml::node& node) {
  switch (node.type()) {
    case toml::node_type::table:
      return "a table";
    case toml::node_type::array:
      return "an array";
    case toml::node_type::string:
      return "the string " + Quote(node.as_string()->get());
    case toml::node_type::integer:
      return "the number " + std::to_string(node.as_integer()->get());
    case toml::node_type::floating_point:
      return "the number " + PrintNumber(node.as_floating_point()->get());
    case toml::node_type::boolean:
      return node.as_boolean()->get() ? "true" : "false";
    default:
      return "a date or time";
  }
}

void Node::Mismatch() const { Fault("is " + Describe(toml) + "; must be " + wanted); }

bool ReadValue(const Node& node, bool& out) {
  const auto* value = node.toml.as_boolean();
  if (value == nullptr) {
    node.Mismatch();
    return false;
  }
  out = value->get();
  return true;
}

bool ReadValue(const Node& node, double& out) {
  const auto value = node.toml.is_number() ? node.toml.value<double>() : std::nullopt;
  if (!value) {
    node.Mismatch();
    return false;
  }
  if (!std::isfinite(*value)) {
    node.Fault("is " + PrintNumber(*value) + "; must be finite, " + node.wanted);
    return false;
  }
  out = *value;
  return true;
}

bool ReadValue(const Node& node, int& out) {
  const auto* value = node.toml.as_integer();
  if (value == nullptr || value->get() < std::numeric_limits<int>::min() ||
      value->get() > std::numeric_limits<int>::max()) {
    node.Mismatch();
    return false;
  }
  out = static_cast<int>(value->get());
  return true;
}

bool ReadValue(const Node& node, std::uint64_t& out) {
  const auto* value = node.toml.as_integer();
  if (value == nullptr || value->get() < 0) {
    node.Mismatch();
    return false;
  }
  out = static_cast<std::uint64_t>(value->get());
  return true;
}

bool ReadValue(const Node& node, std::string& out) {
  const auto* value = node.toml.as_string();
  if (value == nullptr) {
    node.Mismatch();
    return false;
  }
  if (value->get().empty()) {
    node.Fault("is empty; must be " + node.wanted);
    return false;
  }
  out = value->get();
  return true;
}

bool ReadValue(const Node& node, std::filesystem::path& out) {
  std::string text;
  if (!ReadValue(node, text)) return false;
  out = (node.reader.folder() / text).lexically_normal();
  return true;
}

bool ReadValue(const Node& node, std::chrono::milliseconds& out) {
  const auto* text = node.toml.as_string();
  const auto value = text == nullptr ? std::nullopt : ParseDuration(text->get());
  if (!value) {
    node.Mismatch();
    return false;
  }
  out = *value;
  return true;
}

bool ReadValue(const Node& node, std::chrono::minutes& out) {
  const auto* text = node.toml.as_string();
  const auto value = text == nullptr ? std::nullopt : ParseTimeOfDay(text->get());
  if (!value) {
    node.Mismatch();
    return false;
  }
  out = *value;
  return true;
}

bool ReadValue(const Node& node, Eigen::Vector2d& out) {
  const toml::array* pair = node.toml.as_array();
  if (pair == nullptr || pair->size() != 2) {
    node.Mismatch();
    return false;
  }
  Eigen::Vector2d corner;
  for (std::size_t i = 0; i < 2; ++i) {
    const Node element{(*pair)[i], node.key + "[" + std::to_string(i) + "]", "a number (m)", node.reader};
    if (!ReadValue(element, corner[static_cast<Eigen::Index>(i)])) return false;
  }
  out = corner;
  return true;
}

bool ReadValue(const Node& node, std::vector<Feature>& out) {
  const toml::table* table = node.toml.as_table();
  if (table == nullptr) {
    node.Mismatch();
    return false;
  }
  // toml++ sorts by name; what counts is the order in the file.
  std::vector<std::pair<toml::source_position, Feature>> found;
  bool all_well = true;
  for (const auto& [key, value] : *table) {
    const std::string name(key.str());
    const auto note = [&](auto&& setting) { found.emplace_back(value.source().begin, Feature{name, setting}); };
    if (const auto* flag = value.as_boolean()) {
      note(flag->get());
    } else if (const auto* whole = value.as_integer()) {
      note(whole->get());
    } else if (const auto* number = value.as_floating_point(); number != nullptr && std::isfinite(number->get())) {
      note(number->get());
    } else if (const auto* text = value.as_string()) {
      note(text->get());
    } else {
      Node{value, node.key + "." + QuoteKey(name), "true or false, a number or a string", node.reader}.Mismatch();
      all_well = false;
    }
  }
  if (!all_well) return false;
  std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) {
    return std::pair(a.first.line, a.first.column) < std::pair(b.first.line, b.first.column);
  });
  out.clear();
  for (auto& entry : found) out.push_back(std::move(entry.second));
  return true;
}

std::string PrintValue(bool value) { return value ? "true" : "false"; }
std::string PrintValue(double value) { return PrintNumber(value); }
std::string PrintValue(int value) { return std::to_string(value); }
std::string PrintValue(std::uint64_t value) { return std::to_string(value); }
std::string PrintValue(const std::string& value) { return value.empty() ? std::string() : Quote(value); }
std::string PrintValue(const std::filesystem::path& value) { return PrintValue(value.string()); }
std::string PrintValue(std::chrono::milliseconds value) { return Quote(PrintDuration(value)); }
std::string PrintValue(std::chrono::minutes value) { return Quote(PrintTimeOfDay(value)); }
std::string PrintValue(const Eigen::Vector2d& value) {
  return "[" + PrintNumber(value.x()) + ", " + PrintNumber(value.y()) + "]";
}
std::string PrintValue(const std::vector<Feature>& value) {
  std::string out;
  for (const auto& [name, setting] : value) {
    const std::string text = std::visit(
        [](const auto& plain) {
          using V = std::remove_cvref_t<decltype(plain)>;
          if constexpr (std::is_same_v<V, std::string>) return Quote(plain);
          if constexpr (std::is_same_v<V, std::int64_t>) return std::to_string(plain);
          if constexpr (std::is_same_v<V, bool> || std::is_same_v<V, double>) return PrintValue(plain);
        },
        setting);
    out += (out.empty() ? "{ " : ", ") + QuoteKey(name) + " = " + text;
  }
  return out.empty() ? out : out + " }";
}

}  // namespace granary
