// The manual of the configuration, made from the table of keys.
#pragma once

#include <string>
#include <vector>

namespace granary {

/// docs/configuration.md, whole.
[[nodiscard]] std::string ConfigReference();
/// Every key, dotted and without indices: "bin.rig.left.driver". Tables are keys too.
[[nodiscard]] std::vector<std::string> KnownKeys();

}  // namespace granary
