#include "daemon/ctl/registers.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "daemon/modbus/registers.h"

namespace granary {
namespace {

std::string Print(const std::string& format) {
  std::ostringstream out, err;
  EXPECT_EQ(RunRegisters(format, out, err), 0) << err.str();
  EXPECT_EQ(err.str(), "");
  return out.str();
}

TEST(RunRegisters, JsonHoldsEveryRow) {
  const auto map = nlohmann::json::parse(Print("json"));
  EXPECT_EQ(map.at("registers").size(), RegisterTable().size());
  EXPECT_EQ(map.at("status_bits").size(), 16U);
  EXPECT_EQ(map.at("registers")[8].at("name"), "volume");
}

TEST(RunRegisters, CsvHasOneLineARowAndAHead) {
  const auto csv = Print("csv");
  EXPECT_EQ(static_cast<std::size_t>(std::count(csv.begin(), csv.end(), '\n')), RegisterTable().size() + 1);
  EXPECT_NE(csv.find("\n10,f32,2,volume,m³,Volume of the grain\n"), std::string::npos);
}

TEST(RunRegisters, CsvQuotesACommaInAMeaning) {
  EXPECT_NE(Print("csv").find("\"Density used, before the correction\""), std::string::npos);
}

TEST(RunRegisters, TextNamesEveryRow) {
  const auto text = Print("text");
  for (const auto& row : RegisterTable()) EXPECT_NE(text.find(row.name), std::string::npos) << row.name;
}

TEST(RunRegisters, OtherFormatIsBadUsage) {
  std::ostringstream out, err;
  EXPECT_EQ(RunRegisters("xml", out, err), 2);
  EXPECT_EQ(out.str(), "");
  EXPECT_NE(err.str().find("\"xml\""), std::string::npos);
}

// When this fails: put the output of `granaryctl registers --format markdown` between the two marks of docs/modbus.md.
TEST(RunRegisters, ManualIsUpToDate) {
  std::ifstream file(GRANARY_DOCS_DIR "/modbus.md");
  const std::string manual{std::istreambuf_iterator<char>(file), {}};
  const std::string begin = "<!-- granaryctl registers --format markdown -->\n\n", end = "\n<!-- end -->";
  const auto from = manual.find(begin), to = manual.find(end);
  ASSERT_NE(from, std::string::npos);
  ASSERT_NE(to, std::string::npos);
  EXPECT_EQ(manual.substr(from + begin.size(), to - from - begin.size()), Print("markdown"));
}

}  // namespace
}  // namespace granary
