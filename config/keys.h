// The kinds of rows of which keys_*.cpp build the table of keys.
#pragma once

#include <chrono>
#include <climits>
#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "config/reader.h"
#include "config/section.h"
#include "config/values.h"

namespace granary {

// Spoil(value): sets what no range allows and returns true, or returns false where any value may be allowed.
inline bool Spoil(double& value) {
  value = std::numeric_limits<double>::quiet_NaN();
  return true;
}
inline bool Spoil(int& value) {
  value = INT_MIN;
  return true;
}
inline bool Spoil(std::string& value) {
  value.clear();
  return true;
}
inline bool Spoil(std::chrono::milliseconds& value) {
  value = std::chrono::milliseconds::min();
  return true;
}
inline bool Spoil(std::vector<std::string>& value) {
  value.assign(1, "");
  return true;
}
template <typename V>
bool Spoil(std::optional<V>& value) {
  return Spoil(value.emplace());
}
template <typename V>
bool Spoil(V&) {
  return false;
}

// The kinds of rows. `access` gives the place in a T: a pointer to member, or [](auto& t) -> auto& { … }.

/// A plain value of any type that reader.h reads.
template <typename T, typename Access>
Key<T> Value(std::string name, Access access, std::string unit, std::string meaning) {
  using V = std::remove_cvref_t<std::invoke_result_t<Access, T&>>;
  Key<T> key;
  key.name = std::move(name);
  key.type = TypeWords(static_cast<const V*>(nullptr));
  key.unit = std::move(unit);
  key.meaning = std::move(meaning);
  key.read = [access](const Node& node, T& out) { ReadValue(node, std::invoke(access, out)); };
  key.print = [access](const T& value) { return PrintValue(std::invoke(access, value)); };
  V probe{};
  if (Spoil(probe)) key.spoil = [access](T& out) { Spoil(std::invoke(access, out)); };
  return key;
}

/// A duration whose key bears the unit: a whole number of them.
template <typename T, typename Access>
Key<T> Count(std::string name, Access access, std::string unit, std::string meaning) {
  using V = std::remove_cvref_t<std::invoke_result_t<Access, T&>>;
  Key<T> key;
  key.name = std::move(name);
  key.type = TypeWords(static_cast<const int*>(nullptr));
  key.unit = std::move(unit);
  key.meaning = std::move(meaning);
  key.read = [access](const Node& node, T& out) {
    int count = 0;
    if (ReadValue(node, count)) std::invoke(access, out) = V(count);
  };
  key.print = [access](const T& value) { return std::to_string(std::invoke(access, value).count()); };
  key.spoil = [access](T& out) { std::invoke(access, out) = V(INT_MIN); };
  return key;
}

/// One word of several. V is an enum, a string or an optional of these.
template <typename T, typename Access, typename V>
Key<T> Choice(std::string name, Access access, std::vector<std::pair<std::string, V>> choices, std::string meaning) {
  std::vector<std::string> words;
  for (const auto& choice : choices) words.push_back(choice.first);
  Key<T> key;
  key.name = std::move(name);
  key.type = "a string";
  key.meaning = std::move(meaning);
  key.allowed = Join(words, " | ");
  key.read = [access, choices, words](const Node& node, T& out) {
    const auto* text = node.toml.as_string();
    for (const auto& [word, value] : choices) {
      if (text != nullptr && text->get() == word) {
        std::invoke(access, out) = value;
        return;
      }
    }
    const std::string nearest = text == nullptr ? std::string() : Nearest(text->get(), words);
    node.Fault("is " + Describe(node.toml) + (nearest.empty() ? "" : " (did you mean " + Quote(nearest) + "?)") +
               "; must be " + node.wanted);
  };
  key.print = [access, choices](const T& value) {
    for (const auto& [word, choice] : choices) {
      if (std::invoke(access, value) == choice) return Quote(word);
    }
    return std::string();
  };
  return key;
}

/// What all kinds of tables have in common.
template <typename T, typename V>
Key<T> AnyTable(std::string name, std::string type, TableKind kind, const Section<V>& section, std::string meaning) {
  Key<T> key;
  key.name = std::move(name);
  key.type = std::move(type);
  key.meaning = std::move(meaning);
  key.describe = [&section, kind, words = key.meaning](const std::string& path, std::vector<SectionWords>& out) {
    DescribeSection(section, {path, words, kind}, out);
  };
  return key;
}

/// A table of its own: [path.name].
template <typename T, typename Access, typename V>
Key<T> Table(std::string name, Access access, const Section<V>& section, std::string meaning) {
  Key<T> key = AnyTable<T>(std::move(name), "a table", TableKind::kHeader, section, std::move(meaning));
  key.read = [access, &section](const Node& node, T& out) { ReadSection<V>(node, section, std::invoke(access, out)); };
  key.print_tables = [access, &section](const T& value, const std::string& path, std::string& out) {
    PrintSection<V>(std::invoke(access, value), section, path, "[" + path + "]", out);
  };
  return key;
}

/// A table that may be absent: the member is an optional.
template <typename T, typename Access, typename V>
Key<T> OptionalTable(std::string name, Access access, const Section<V>& section, std::string meaning) {
  Key<T> key = AnyTable<T>(std::move(name), "a table", TableKind::kHeader, section, std::move(meaning));
  key.read = [access, &section](const Node& node, T& out) {
    ReadSection<V>(node, section, std::invoke(access, out).emplace());
  };
  key.print_tables = [access, &section](const T& value, const std::string& path, std::string& out) {
    const auto& table = std::invoke(access, value);
    if (table) PrintSection<V>(*table, section, path, "[" + path + "]", out);
  };
  return key;
}

/// A table printed on one line: name = { … }. It may be given with a header as well.
template <typename T, typename Access, typename V>
Key<T> InlineTable(std::string name, Access access, const Section<V>& section, std::string meaning) {
  Key<T> key = AnyTable<T>(std::move(name), "a table in braces", TableKind::kInline, section, std::move(meaning));
  key.read = [access, &section](const Node& node, T& out) { ReadSection<V>(node, section, std::invoke(access, out)); };
  key.print = [access, &section](const T& value) {
    return "{ " + PrintValues<V>(std::invoke(access, value), section, ", ") + " }";
  };
  return key;
}

/// An array of tables: [[path.name]].
template <typename T, typename Access, typename V>
Key<T> Tables(std::string name, Access access, const Section<V>& section, std::string meaning) {
  Key<T> key = AnyTable<T>(std::move(name), "an array of tables", TableKind::kArray, section, std::move(meaning));
  key.read = [access, &section](const Node& node, T& out) {
    const toml::array* array = node.toml.as_array();
    if (array == nullptr) {
      node.Fault("is " + Describe(node.toml) + "; must be an array of tables, each under a header in double brackets");
      return;
    }
    for (std::size_t i = 0; i < array->size(); ++i) {
      const Node element{(*array)[i], node.key + "[" + std::to_string(i) + "]", node.wanted, node.reader};
      ReadSection<V>(element, section, std::invoke(access, out).emplace_back());
    }
  };
  key.print_tables = [access, &section](const T& value, const std::string& path, std::string& out) {
    for (const auto& element : std::invoke(access, value)) {
      PrintSection<V>(element, section, path, "[[" + path + "]]", out);
    }
  };
  return key;
}

/// The whole file.
[[nodiscard]] const Section<Config>& ConfigSection();
[[nodiscard]] const Section<BinConfig>& BinSection();
[[nodiscard]] const Section<RigOptions>& RigSection();
/// Every table of the file, for the manual.
[[nodiscard]] std::vector<SectionWords> DescribeConfig();

}  // namespace granary
