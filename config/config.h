// The one configuration file, read whole or not at all.
#pragma once

#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/options.h"
#include "drivers/options.h"
#include "pipeline/options.h"
#include "pipeline/types/bin.h"

namespace granary {

struct Config {
  std::filesystem::path file;  ///< where it was read from; paths inside are already absolute
  std::string site_name = "granary";
  std::string log_level = "info";  ///< trace | debug | info | warn | error
  ModbusOptions modbus;
  std::vector<BinConfig> bins;
};

/// One fault of the file.
struct ConfigFault {
  std::string file;
  int line = 0;         ///< 1-based; of a missing key, that of its table; 0 when there is no file to read
  std::string key;      ///< dotted, e.g. "bin[0].rig[0].left.driver"
  std::string message;  ///< what is wrong, what is allowed
  /// `FILE:LINE: key: message`
  [[nodiscard]] std::string Text() const;
};

/// All faults at once; what() is their texts, one a line.
class ConfigError : public std::runtime_error {
 public:
  explicit ConfigError(std::vector<ConfigFault> faults);
  [[nodiscard]] const std::vector<ConfigFault>& faults() const { return faults_; }

 private:
  std::vector<ConfigFault> faults_;
};

/// Reads and checks `file`. @throws ConfigError with every fault found.
[[nodiscard]] Config LoadConfig(const std::filesystem::path& file);
/// The same from text; `file` names it in messages and anchors relative paths.
[[nodiscard]] Config ParseConfig(std::string_view toml, const std::filesystem::path& file);
/// The effective configuration as TOML, defaults included; ParseConfig of it gives the same configuration.
[[nodiscard]] std::string PrintConfig(const Config& config);

}  // namespace granary
