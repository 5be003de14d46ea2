// The effective configuration: every key that has a value, defaults included, in the order of the table of keys.
#include "config/keys.h"

namespace granary {

std::string PrintConfig(const Config& config) {
  std::string out;
  PrintSection(config, ConfigSection(), "", "", out);
  return out;
}

}  // namespace granary
