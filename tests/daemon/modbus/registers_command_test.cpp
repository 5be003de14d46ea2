#include "daemon/ctl/registers.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <utility>

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
  EXPECT_NE(csv.find("\n10,f32,2,volume,m³,r,Volume of the grain\n"), std::string::npos);
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

std::string ReadFile(const std::string& name) {
  std::ifstream file(GRANARY_DOCS_DIR "/" + name);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(RunRegisters, ManualIsUpToDate) {
  const std::string manual = ReadFile("modbus.md");
  const std::string begin = "<!-- granaryctl registers --format markdown -->\n\n", end = "\n<!-- end -->";
  const auto from = manual.find(begin), to = manual.find(end);
  ASSERT_NE(from, std::string::npos);
  ASSERT_NE(to, std::string::npos);
  EXPECT_EQ(manual.substr(from + begin.size(), to - from - begin.size()), Print("markdown"))
      << "refresh it: tests/tools/update-docs.sh BUILD_FOLDER";
}

class ScadaFile : public testing::TestWithParam<std::pair<std::string, std::string>> {};

TEST_P(ScadaFile, IsUpToDate) {
  const auto& [format, name] = GetParam();
  EXPECT_EQ(ReadFile("scada/" + name), Print(format)) << "refresh it: tests/tools/update-docs.sh BUILD_FOLDER";
}

INSTANTIATE_TEST_SUITE_P(RunRegisters, ScadaFile,
                         testing::Values(std::pair{"csv", "granary-registers.csv"},
                                         std::pair{"json", "granary-registers.json"},
                                         std::pair{"telegraf", "telegraf.conf"},
                                         std::pair{"node-red", "node-red-flow.json"},
                                         std::pair{"ignition", "ignition-tags.csv"}));

TEST(PrintTelegraf, EachRequestIsOneRunOfAtMost125Registers) {
  std::istringstream lines(Print("telegraf"));
  const std::regex field(R"(address = (\d+), .*type = "(\w+)\")");
  int first = -1, next = -1, requests = 0;
  for (std::string line; std::getline(lines, line);) {
    if (line.find("[[inputs.modbus.request]]") != std::string::npos) {
      first = next = -1;
      ++requests;
    }
    std::smatch found;
    if (!std::regex_search(line, found, field)) continue;
    const int address = std::stoi(found[1]);
    if (first < 0) first = next = address;
    EXPECT_EQ(address, next) << "Telegraf would make two requests of it: " << line;
    next = address + (found[2] == "UINT16" ? 1 : 2);
    EXPECT_LE(next - first, 125) << line;
  }
  EXPECT_EQ(requests, 2);
}

TEST(PrintNodeRed, EveryWireEndsAtANode) {
  const auto flow = nlohmann::json::parse(Print("node-red"));
  std::set<std::string> ids;
  for (const auto& node : flow) ids.insert(node.at("id").get<std::string>());
  EXPECT_EQ(ids.size(), flow.size());
  for (const auto& node : flow) {
    for (const auto& output : node.value("wires", nlohmann::json::array())) {
      for (const auto& target : output) EXPECT_TRUE(ids.contains(target.get<std::string>())) << target;
    }
    if (node.contains("server")) {
      EXPECT_TRUE(ids.contains(node["server"].get<std::string>()));
    }
  }
}

TEST(PrintNodeRed, ReadsTheWholeSummaryAtOnce) {
  for (const auto& node : nlohmann::json::parse(Print("node-red"))) {
    if (node.at("type") != "modbus-read") continue;
    EXPECT_EQ(node.at("adr"), "0");
    EXPECT_EQ(node.at("quantity"), "65");
  }
}

TEST(PrintIgnition, HasOneTagARegisterButTheMirrors) {
  std::istringstream lines(Print("ignition"));
  std::string line;
  ASSERT_TRUE(std::getline(lines, line) && std::getline(lines, line));
  EXPECT_TRUE(line.starts_with("# version=1"));
  for (const auto& row : RegisterTable()) {
    if (row.type == RegisterType::kMirror) continue;
    ASSERT_TRUE(std::getline(lines, line)) << row.name;
    EXPECT_TRUE(line.starts_with("," + std::string(row.name) + ",,0,")) << line;
  }
  EXPECT_FALSE(std::getline(lines, line)) << line;
}

TEST(PrintIgnition, IsAscii) {
  const auto tags = Print("ignition");
  EXPECT_EQ(std::find_if(tags.begin(), tags.end(), [](char c) { return static_cast<unsigned char>(c) > 0x7E; }),
            tags.end());
}

TEST(RunRegisters, UnitIdIsThatOfTheBin) {
  for (const auto& [format, expected] : {std::pair{"telegraf", "slave_id = 7\n"},
                                         {"node-red", "\"unitid\": \"7\""},
                                         {"ignition", "[granary]7.HRF10,"}}) {
    std::ostringstream out, err;
    EXPECT_EQ(RunRegisters(format, out, err, 7), 0);
    EXPECT_NE(out.str().find(expected), std::string::npos) << format;
  }
}

}  // namespace
}  // namespace granary
