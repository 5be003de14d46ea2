// Where the tools print: documents to standard output, everything else beside it.
#include <iostream>
#include <optional>
#include <string>

#include "daemon/ctl/command.h"

namespace granary {

nlohmann::ordered_json OrNull(const std::optional<double>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json();
}

void PrintJson(const nlohmann::ordered_json& document) {
  std::cout << document.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) << '\n';
}

void Say(const std::string& line) { std::cerr << line << '\n'; }

}  // namespace granary
