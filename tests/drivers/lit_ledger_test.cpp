#include "drivers/lit_ledger.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <random>
#include <utility>
#include <vector>

namespace granary {
namespace {

using namespace std::chrono_literals;

LitLedger::Time At(std::chrono::microseconds time) { return LitLedger::Time(1h + time); }

TEST(LitBetween, CountsPartsOfPulses) {
  LitLedger ledger;
  ledger.Add(At(0ms), At(100ms));
  ledger.Add(At(200ms), At(250ms));
  EXPECT_EQ(ledger.LitBetween(At(50ms), At(210ms)), 60ms);
}

TEST(AllowedFrom, IsNowWhileThereIsRoom) {
  LitLedger ledger;
  ledger.Add(At(0ms), At(900ms));
  EXPECT_EQ(ledger.AllowedFrom(At(1s), 100ms, 1s), At(1s));
}

TEST(AllowedFrom, WaitsUntilEnoughHasLeftTheWindow) {
  LitLedger ledger;
  ledger.Add(At(0ms), At(500ms));
  ledger.Add(At(2s), At(2500ms));
  // Of 1000 ms 300 have to go; the window ends with the pulse.
  EXPECT_EQ(ledger.AllowedFrom(At(3s), 300ms, 1s), At(300ms + 10s - 300ms));
  EXPECT_EQ(ledger.AllowedFrom(At(3s), 700ms, 1s), At(2s + 200ms + 10s - 700ms));
}

TEST(AllowedFrom, KeepsEveryWindowOfRandomPulsesWithinTheLimit) {
  std::mt19937 random(7);
  std::uniform_int_distribution<int> width_us(100, 60'000), pause_us(0, 400'000);
  LitLedger ledger;
  std::vector<std::pair<LitLedger::Time, LitLedger::Time>> pulses;
  LitLedger::Time now = At(0s);
  for (int i = 0; i < 2000; ++i) {
    const std::chrono::microseconds width(width_us(random));
    const auto from = ledger.AllowedFrom(now, width, 500ms);
    ASSERT_GE(from, now);
    ledger.Add(from, from + width);
    pulses.emplace_back(from, from + width);
    now = from + width + std::chrono::microseconds(pause_us(random));
  }
  // The lit time of a window changes its slope at the edges of pulses only: its worst ends at one.
  for (std::size_t last = 0; last < pulses.size(); ++last) {
    const auto until = pulses[last].second, from = until - LitLedger::kWindow;
    LitLedger::Duration lit{0};
    for (std::size_t i = last + 1; i-- > 0 && pulses[i].second > from;) {
      lit += pulses[i].second - std::max(pulses[i].first, from);
    }
    ASSERT_LE(lit, 500ms) << "in the window that ends with pulse " << last;
  }
}

TEST(LedgerOfLine, IsTheSameForTheSameLine) {
  LedgerOfLine("chip line 1")->Add(At(0ms), At(7ms));
  EXPECT_EQ(LedgerOfLine("chip line 1")->LitBetween(At(0ms), At(1s)), 7ms);
  EXPECT_EQ(LedgerOfLine("chip line 2")->LitBetween(At(0ms), At(1s)), 0ms);
}

}  // namespace
}  // namespace granary
