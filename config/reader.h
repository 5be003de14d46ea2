// Reading TOML nodes into values, with every fault noted at its line and none of them stopping the reading.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <toml++/toml.h>
#include <Eigen/Core>

#include "config/config.h"
#include "drivers/options.h"

namespace granary {

/// What one reading of a file collects.
class Reader {
 public:
  /// @param file names the file in messages  @param folder anchors relative paths
  Reader(std::string file, std::filesystem::path folder) : file_(std::move(file)), folder_(std::move(folder)) {}
  void Fault(int line, std::string key, std::string message);
  /// True when a fault was noted at `key` or below it.
  [[nodiscard]] bool HasFault(std::string_view key) const;
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  /// True when a fault was noted at exactly `key`.
  [[nodiscard]] bool HasFaultAt(std::string_view key) const;
  /// True when a fault was noted below `table` at a key whose last part is `name`.
  [[nodiscard]] bool HasFaultNamed(std::string_view table, std::string_view name) const;
  /// Ordered by line.
  [[nodiscard]] std::vector<ConfigFault> Faults() const;

 private:
  std::string file_;
  std::filesystem::path folder_;
  std::vector<ConfigFault> faults_;
};

/// One value of the file and where it stands; borrowed for the time of one reading.
struct Node {
  const toml::node& toml;
  std::string key;     ///< dotted, from the root
  std::string wanted;  ///< for messages: "a number (m), more than 0"
  Reader& reader;

  [[nodiscard]] int Line() const { return static_cast<int>(toml.source().begin.line); }
  void Fault(std::string message) const { reader.Fault(Line(), key, std::move(message)); }
  /// Notes that the value is not what was wanted.
  void Mismatch() const;
};

/// What stands there, in a few words: `the string "on"`, `the number 3.5`, "a table".
[[nodiscard]] std::string Describe(const toml::node& node);

// TypeWords(nullptr of T): what a T is called in messages and in the manual.
[[nodiscard]] inline std::string TypeWords(const bool*) { return "true or false"; }
[[nodiscard]] inline std::string TypeWords(const double*) { return "a number"; }
[[nodiscard]] inline std::string TypeWords(const int*) { return "a whole number"; }
[[nodiscard]] inline std::string TypeWords(const std::uint64_t*) { return "a whole number, not negative"; }
[[nodiscard]] inline std::string TypeWords(const std::string*) { return "a string"; }
[[nodiscard]] inline std::string TypeWords(const std::filesystem::path*) { return "a path in quotes"; }
[[nodiscard]] inline std::string TypeWords(const std::chrono::milliseconds*) {
  return "a duration with its unit (ms, s, min, h, d) in quotes";
}
[[nodiscard]] inline std::string TypeWords(const std::chrono::minutes*) { return "a time of the day in quotes"; }
[[nodiscard]] inline std::string TypeWords(const Eigen::Vector2d*) { return "a corner [x, y]"; }
[[nodiscard]] inline std::string TypeWords(const std::vector<Feature>*) { return "a table in braces"; }
[[nodiscard]] inline std::string TypeWords(const std::vector<Eigen::Vector2d>*) { return "a polygon [[x, y], …]"; }
template <typename T>
[[nodiscard]] std::string TypeWords(const std::vector<T>*) {
  return "an array, each element " + TypeWords(static_cast<const T*>(nullptr));
}
template <typename T>
[[nodiscard]] std::string TypeWords(const std::optional<T>*) {
  return TypeWords(static_cast<const T*>(nullptr));
}

// ReadValue(node, out): sets `out` and returns true, or notes the fault, leaves `out` as it was and returns false.
bool ReadValue(const Node& node, bool& out);
bool ReadValue(const Node& node, double& out);  ///< integers too; nan and inf are faults
bool ReadValue(const Node& node, int& out);
bool ReadValue(const Node& node, std::uint64_t& out);
bool ReadValue(const Node& node, std::string& out);                ///< an empty string is a fault
bool ReadValue(const Node& node, std::filesystem::path& out);      ///< made absolute from the file's folder
bool ReadValue(const Node& node, std::chrono::milliseconds& out);  ///< a string with a unit
bool ReadValue(const Node& node, std::chrono::minutes& out);       ///< a time of the day, "HH:MM"
bool ReadValue(const Node& node, Eigen::Vector2d& out);            ///< [x, y]
bool ReadValue(const Node& node, std::vector<Feature>& out);       ///< a table, in the order of the file

/// An array. Elements that are no T leave a fault at their own line, and the whole array unread.
template <typename T>
bool ReadValue(const Node& node, std::vector<T>& out) {
  const toml::array* array = node.toml.as_array();
  if (array == nullptr) {
    node.Mismatch();
    return false;
  }
  std::vector<T> values(array->size());
  bool all_well = true;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const Node element{(*array)[i], node.key + "[" + std::to_string(i) + "]", TypeWords(static_cast<const T*>(nullptr)),
                       node.reader};
    all_well = ReadValue(element, values[i]) && all_well;
  }
  if (all_well) out = std::move(values);
  return all_well;
}

template <typename T>
bool ReadValue(const Node& node, std::optional<T>& out) {
  T value{};
  if (!ReadValue(node, value)) return false;
  out = std::move(value);
  return true;
}

// PrintValue(value): the TOML that ReadValue reads back to the same; empty when there is no value (an empty string is
// none).
[[nodiscard]] std::string PrintValue(bool value);
[[nodiscard]] std::string PrintValue(double value);
[[nodiscard]] std::string PrintValue(int value);
[[nodiscard]] std::string PrintValue(std::uint64_t value);
[[nodiscard]] std::string PrintValue(const std::string& value);
[[nodiscard]] std::string PrintValue(const std::filesystem::path& value);
[[nodiscard]] std::string PrintValue(std::chrono::milliseconds value);
[[nodiscard]] std::string PrintValue(std::chrono::minutes value);
[[nodiscard]] std::string PrintValue(const Eigen::Vector2d& value);
[[nodiscard]] std::string PrintValue(const std::vector<Feature>& value);  ///< empty when there is none

template <typename T>
[[nodiscard]] std::string PrintValue(const std::vector<T>& values) {
  std::string out;
  for (const auto& value : values) out += (out.empty() ? "" : ", ") + PrintValue(value);
  return "[" + out + "]";
}

template <typename T>
[[nodiscard]] std::string PrintValue(const std::optional<T>& value) {
  return value ? PrintValue(*value) : std::string();
}

}  // namespace granary
