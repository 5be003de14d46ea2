#include "daemon/progress.h"

#include <gtest/gtest.h>

#include "daemon/fault_log.h"
#include "daemon/systemd.h"
#include "tests/daemon/fakes.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
const auto kNow = std::chrono::steady_clock::time_point{} + 1h;

TEST(Progress, IsKeptUntilTheDeadline) {
  Progress progress;
  progress.Promise(kNow, 30s);
  EXPECT_TRUE(progress.Kept(kNow + 30s));
  EXPECT_FALSE(progress.Kept(kNow + 30s + 1ms));
}

TEST(Progress, IsKeptAgainAfterANewPromise) {
  Progress progress;
  progress.Promise(kNow, 30s);
  progress.Promise(kNow + 60s, 30s);
  EXPECT_TRUE(progress.Kept(kNow + 61s));
}

TEST(Progress, IsKeptBeforeTheFirstPromise) { EXPECT_TRUE(Progress().Kept(kNow)); }

TEST(DeadlineOf, LeavesTimeForTheRetryDelay) {
  CycleOptions options;
  options.retry_delay = 10min;
  EXPECT_GT(DeadlineOf(CycleState::kRetrying, options, 1), options.retry_delay);
}

TEST(DeadlineOf, GrowsWithTheRigs) {
  EXPECT_EQ(DeadlineOf(CycleState::kCapturing, {}, 3), 3 * DeadlineOf(CycleState::kCapturing, {}, 1));
}

TEST(TickState, FeedsTheWatchdogOnlyOnProgress) {
  EXPECT_EQ(TickState(true, {}).rfind("WATCHDOG=1\n", 0), 0U);
  EXPECT_EQ(TickState(false, {}).find("WATCHDOG=1"), std::string::npos);
}

TEST(StatusText, SaysWhatIsHeldAndWhy) {
  BinSnapshot snapshot;
  snapshot.bin.name = "bay-1";
  snapshot.good = Valid(0.019);
  snapshot.last = Verdict(Reason::kFrameMissing);
  snapshot.held = true;
  snapshot.next_at = At("2026-11-22T06:30:00Z");
  EXPECT_EQ(StatusText({snapshot}), "bin 1 bay-1: 0.019 m³ held (frame_missing), next 2026-11-22T06:30:00Z");
}

TEST(StatusText, SaysThatNothingIsKnownYet) {
  BinSnapshot snapshot;
  snapshot.bin.name = "bay-1";
  EXPECT_EQ(StatusText({snapshot}), "bin 1 bay-1: no figure yet");
}

TEST(FaultLog, SpeaksOnChangeThenHourly) {
  FaultLog log;
  EXPECT_TRUE(log.Raise("dark", kNow));
  EXPECT_FALSE(log.Raise("dark", kNow + 59min));
  EXPECT_TRUE(log.Raise("blurred", kNow + 59min));
  EXPECT_FALSE(log.Raise("blurred", kNow + 118min));
  EXPECT_TRUE(log.Raise("blurred", kNow + 119min));
}

TEST(FaultLog, TellsTheEndOnce) {
  FaultLog log;
  EXPECT_TRUE(log.Raise("dark", kNow));
  EXPECT_TRUE(log.Clear());
  EXPECT_FALSE(log.Clear());
}

}  // namespace
}  // namespace granary
