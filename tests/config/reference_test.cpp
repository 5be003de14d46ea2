// The manual and the shipped example keep up with the table of keys.
#include "config/reference.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <sstream>

namespace granary {
namespace {

std::string ReadText(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  EXPECT_TRUE(stream) << file;
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

/// Keys and tables that a TOML text shows, commented out or not, dotted and without indices.
std::set<std::string> ShownKeys(const std::string& text) {
  static const std::regex header(R"(^#?\[{1,2}([\w.]+)\]{1,2}.*)");
  static const std::regex pair(R"(^#?(\w+)\s*=\s*(.*))");
  static const std::regex inner(R"((\w+)\s*=)");
  std::set<std::string> keys;
  std::string table;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::smatch match;
    if (std::regex_match(line, match, header)) {
      table = match[1];
      for (std::string path = table; !path.empty();) {
        keys.insert(path);
        const auto dot = path.rfind('.');
        path.resize(dot == std::string::npos ? 0 : dot);
      }
    } else if (std::regex_match(line, match, pair)) {
      const std::string key = table + "." + match[1].str(), value = match[2];
      keys.insert(key);
      // The names inside features are the cameras' own.
      if (value.empty() || value[0] != '{' || match[1] == "features") continue;
      const std::string braces = value.substr(0, value.find('}'));
      for (std::sregex_iterator it(braces.begin(), braces.end(), inner), end; it != end; ++it) {
        keys.insert(key + "." + (*it)[1].str());
      }
    }
  }
  return keys;
}

TEST(KnownKeys, HoldsNestedKeysOfBothCameras) {
  EXPECT_THAT(KnownKeys(),
              ::testing::IsSupersetOf({"site.name", "modbus.tcp.listen", "bin.schedule.every", "bin.rig.left.driver",
                                       "bin.rig.right.driver", "bin.rig.sim.seed"}));
}

TEST(ShippedConfig, ShowsEveryKnownKey) {
  const auto shown = ShownKeys(ReadText(GRANARY_CONFIG_FOLDER "/granaryd.toml"));
  for (const auto& key : KnownKeys()) EXPECT_TRUE(shown.count(key)) << key << " is not in config/granaryd.toml";
}

TEST(ShippedConfig, ShowsNoOtherKey) {
  const auto known = KnownKeys();
  for (const auto& key : ShownKeys(ReadText(GRANARY_CONFIG_FOLDER "/granaryd.toml"))) {
    EXPECT_THAT(known, ::testing::Contains(key)) << "config/granaryd.toml shows a key that is none";
  }
}

TEST(ConfigReference, IsWhatDocsHold) {
  EXPECT_EQ(ReadText(GRANARY_DOCS_FOLDER "/configuration.md"), ConfigReference())
      << "write it anew: granary_config_reference > docs/configuration.md";
}

}  // namespace
}  // namespace granary
