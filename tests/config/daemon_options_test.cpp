#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "daemon/options.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(ParseHostPort, SplitsNameAndPort) {
  const auto end_point = ParseHostPort("plc.depot:502");
  ASSERT_TRUE(end_point);
  EXPECT_EQ(end_point->host, "plc.depot");
  EXPECT_EQ(end_point->port, 502);
}

TEST(ParseHostPort, TakesIpv6InBracketsOnly) {
  ASSERT_TRUE(ParseHostPort("[::1]:502"));
  EXPECT_EQ(ParseHostPort("[::1]:502")->host, "::1");
  EXPECT_FALSE(ParseHostPort("::1:502"));
  EXPECT_FALSE(ParseHostPort("[10.0.0.1]:502"));
}

TEST(ParseHostPort, RefusesWhatIsNone) {
  for (const char* text :
       {"", ":502", "host", "host:", "host:0", "host:65536", "host:-1", "host:5a", "a b:1", "[]:1"}) {
    EXPECT_FALSE(ParseHostPort(text)) << text;
  }
}

TEST(PrintHostPort, IsTheInverse) {
  EXPECT_EQ(PrintHostPort({"::1", 502}), "[::1]:502");
  EXPECT_EQ(PrintHostPort({"10.0.0.1", 502}), "10.0.0.1:502");
}

TEST(Faults, FindsNoneInTheDefaults) {
  EXPECT_THAT(Faults(ScheduleOptions{}), IsEmpty());
  EXPECT_THAT(Faults(CycleOptions{}), IsEmpty());
  EXPECT_THAT(Faults(ModbusTcpOptions{}), IsEmpty());
}

TEST(Faults, JudgesEveryOnlyWithoutTimes) {
  EXPECT_THAT(Faults(ScheduleOptions{99ms, {}, "UTC"}), ElementsAre(HasSubstr("every: must be")));
  EXPECT_THAT(Faults(ScheduleOptions{99ms, {360min}, "UTC"}), IsEmpty());
}

TEST(Faults, WantsTimesOfOneDay) {
  EXPECT_THAT(Faults(ScheduleOptions{1h, {360min, 1440min}, "UTC"}), ElementsAre(HasSubstr("at: must be")));
}

TEST(Faults, TakesIpv6Networks) {
  ModbusTcpOptions options;
  options.allow = {"fd00::/8", "::1/128"};
  EXPECT_THAT(Faults(options), IsEmpty());
  options.allow = {"fd00::/129"};
  EXPECT_THAT(Faults(options), ElementsAre(HasSubstr("allow[0]: 'fd00::/129' is no network")));
}

TEST(Faults, NamesEachBadNetwork) {
  ModbusTcpOptions options;
  options.write_allow = {"10.0.0.1", "10.0.0.0/8", "10.0.0.1/8"};
  EXPECT_THAT(Faults(options), ElementsAre(HasSubstr("write_allow[0]"), HasSubstr("write_allow[2]")));
}

TEST(Faults, WantsASerialPort) {
  EXPECT_THAT(Faults(ModbusRtuOptions{}), ElementsAre(HasSubstr("device: must be a serial port")));
}

}  // namespace
}  // namespace granary
