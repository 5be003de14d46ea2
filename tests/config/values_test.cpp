#include "config/values.h"

#include <gtest/gtest.h>

#include <limits>

namespace granary {
namespace {

using namespace std::chrono_literals;

TEST(ParseDuration, TakesEveryUnit) {
  EXPECT_EQ(ParseDuration("250ms"), 250ms);
  EXPECT_EQ(ParseDuration("10s"), 10s);
  EXPECT_EQ(ParseDuration("30min"), 30min);
  EXPECT_EQ(ParseDuration("1h"), 1h);
  EXPECT_EQ(ParseDuration("2d"), 48h);
}

TEST(ParseDuration, TakesDecimalsThatAreWholeMilliseconds) {
  EXPECT_EQ(ParseDuration("0.1s"), 100ms);
  EXPECT_EQ(ParseDuration("1.5h"), 90min);
}

TEST(ParseDuration, RefusesWhatIsNone) {
  for (const char* text : {"", "s", "10", "10 s", "10m", "-1s", "-0s", "1s1", "1e3s", "0.1ms", "inf s", "nans",
                           "99999999999d", "0x10s", "10S"}) {
    EXPECT_FALSE(ParseDuration(text).has_value()) << text;
  }
}

TEST(PrintDuration, UsesTheLargestUnitThatIsWhole) {
  EXPECT_EQ(PrintDuration(0ms), "0s");
  EXPECT_EQ(PrintDuration(250ms), "250ms");
  EXPECT_EQ(PrintDuration(90min), "90min");
  EXPECT_EQ(PrintDuration(24h), "1d");
}

TEST(ParseTimeOfDay, TakesMidnightToTheLastMinute) {
  EXPECT_EQ(ParseTimeOfDay("00:00"), 0min);
  EXPECT_EQ(ParseTimeOfDay("23:59"), 1439min);
}

TEST(ParseTimeOfDay, RefusesWhatIsNone) {
  for (const char* text : {"", "6:00", "06:60", "24:00", "06:00:00", "0600 ", "ab:cd", "-1:00"}) {
    EXPECT_FALSE(ParseTimeOfDay(text).has_value()) << text;
  }
}

TEST(PrintTimeOfDay, PadsWithZeros) { EXPECT_EQ(PrintTimeOfDay(65min), "01:05"); }

TEST(PrintNumber, IsTheShortestThatReadsBack) {
  EXPECT_EQ(PrintNumber(0.1), "0.1");
  EXPECT_EQ(PrintNumber(15200), "15200.0");
  EXPECT_EQ(std::stod(PrintNumber(1.0 / 3)), 1.0 / 3);
}

TEST(Quote, EscapesWhatTomlForbids) { EXPECT_EQ(Quote("a\"b\\c\n\x7f"), R"("a\"b\\c\u000A\u007F")"); }

TEST(Quote, LeavesUtf8Alone) { EXPECT_EQ(Quote("仓"), "\"仓\""); }

TEST(QuoteKey, QuotesOnlyWhereItMust) {
  EXPECT_EQ(QuoteKey("book_mass_kg"), "book_mass_kg");
  EXPECT_EQ(QuoteKey("a b"), "\"a b\"");
  EXPECT_EQ(QuoteKey(""), "\"\"");
}

TEST(Nearest, FindsASwapOfTwoLetters) { EXPECT_EQ(Nearest("hieght_m", {"id", "height_m", "name"}), "height_m"); }

TEST(Nearest, FindsAForgottenUnit) { EXPECT_EQ(Nearest("density", {"loss_kg", "density_kg_m3"}), "density_kg_m3"); }

TEST(Nearest, SuggestsNothingForAnotherWord) { EXPECT_EQ(Nearest("voltage", {"id", "name", "height_m"}), ""); }

}  // namespace
}  // namespace granary
