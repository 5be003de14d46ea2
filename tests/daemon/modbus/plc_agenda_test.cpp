// When a block is due; the clock is a number here.
#include "daemon/modbus/plc_agenda.h"

#include <chrono>
#include <memory>
#include <optional>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/modbus/snapshots.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr auto kHeartbeat = 10s;

std::shared_ptr<const BinSnapshot> Shared(BinSnapshot snapshot) {
  return std::make_shared<const BinSnapshot>(std::move(snapshot));
}

std::shared_ptr<const BinSnapshot> MeasuredAt(UtcTime utc) {
  BinSnapshot snapshot = test::GoodSnapshot();
  snapshot.good->utc = snapshot.last->utc = utc;
  return Shared(std::move(snapshot));
}

/// One bin whose block was taken at `t0_`.
class PlcAgendaTest : public ::testing::Test {
 protected:
  PlcAgendaTest() { agenda_.Taken(0, taken_, t0_); }
  [[nodiscard]] bool IsDue(const BinSnapshot& snapshot, std::chrono::milliseconds later) const {
    return !agenda_.Due({Shared(snapshot)}, t0_ + later).empty();
  }

  const PlcAgenda::Time t0_{1000s};
  BinSnapshot taken_ = test::GoodSnapshot();
  PlcAgenda agenda_{1, kHeartbeat, PlcLimits{}, 1};
};

TEST_F(PlcAgendaTest, NothingIsDueBeforeTheFirstSnapshot) {
  const PlcAgenda fresh(2, kHeartbeat, PlcLimits{}, 1);
  EXPECT_THAT(fresh.Due({nullptr, nullptr}, t0_), IsEmpty());
  EXPECT_EQ(fresh.NextAt({nullptr, nullptr}), PlcAgenda::Time::max());
}

TEST_F(PlcAgendaTest, FirstSnapshotIsDueAtOnce) {
  const PlcAgenda fresh(2, kHeartbeat, PlcLimits{}, 1);
  EXPECT_THAT(fresh.Due({nullptr, Shared(taken_)}, t0_), ElementsAre(1));
}

TEST_F(PlcAgendaTest, SameFiguresWaitForTheHeartbeat) {
  EXPECT_FALSE(IsDue(taken_, 9999ms));
  EXPECT_TRUE(IsDue(taken_, 10000ms));
  EXPECT_EQ(agenda_.NextAt({Shared(taken_)}), t0_ + kHeartbeat);
}

TEST_F(PlcAgendaTest, WorkersHeartbeatIsNoNews) {
  ++taken_.heartbeat;
  EXPECT_FALSE(IsDue(taken_, 9999ms));
}

TEST_F(PlcAgendaTest, NewMeasurementIsDueAtOnce) {
  ++taken_.good->sequence;
  EXPECT_TRUE(IsDue(taken_, 0ms));
}

TEST_F(PlcAgendaTest, FailedCycleIsDueAtOnce) { EXPECT_TRUE(IsDue(test::HeldSnapshot(Reason::kFrameMissing), 0ms)); }

TEST_F(PlcAgendaTest, InjectedFigureIsDueAtOnce) {
  taken_.injected = true;
  EXPECT_TRUE(IsDue(taken_, 0ms));
}

TEST_F(PlcAgendaTest, StatusAloneIsDueAtMostOnceASecond) {
  taken_.measuring = true;
  EXPECT_FALSE(IsDue(taken_, 999ms));
  EXPECT_TRUE(IsDue(taken_, 1000ms));
}

TEST_F(PlcAgendaTest, AcknowledgedAlarmIsDueWithinASecond) {
  taken_.abnormal_latched = true;
  agenda_.Taken(0, taken_, t0_);
  taken_.abnormal_latched = false;
  EXPECT_TRUE(IsDue(taken_, 1000ms));
}

TEST_F(PlcAgendaTest, NewestMeasurementGoesFirst) {
  const PlcAgenda fresh(4, kHeartbeat, PlcLimits{}, 1);
  const auto oldest = MeasuredAt(test::kMeasuredAt), newest = MeasuredAt(test::kMeasuredAt + 2min);
  const auto middle = MeasuredAt(test::kMeasuredAt + 1min), none = Shared(test::UnmeasuredSnapshot());
  EXPECT_THAT(fresh.Due({none, oldest, newest, middle}, t0_), ElementsAre(2, 3, 1, 0));
}

TEST_F(PlcAgendaTest, NewConnectionMakesAllDue) {
  agenda_.ConnectedAnew();
  EXPECT_TRUE(IsDue(taken_, 0ms));
}

TEST_F(PlcAgendaTest, LastingRefusalWaitsLong) {
  agenda_.Refused(0, true, t0_);
  EXPECT_FALSE(IsDue(taken_, 44999ms));  // 60 s − 25 %
  EXPECT_TRUE(IsDue(taken_, 75s));       // 60 s + 25 %
}

TEST_F(PlcAgendaTest, NewMeasurementDoesNotShortenARefusal) {
  agenda_.Refused(0, true, t0_);
  ++taken_.good->sequence;
  EXPECT_FALSE(IsDue(taken_, 44999ms));
}

TEST_F(PlcAgendaTest, PassingRefusalIsTriedAgainSoon) {
  agenda_.Refused(0, false, t0_);
  EXPECT_FALSE(IsDue(taken_, 374ms));
  EXPECT_TRUE(IsDue(taken_, 625ms));
}

TEST(Backoff, DoublesToTheLongestWithin25Percent) {
  Backoff backoff(PlcLimits{}, 7);
  for (const auto nominal : {500, 1000, 2000, 4000, 8000, 16000, 32000, 60000, 60000, 60000}) {
    const auto wait = backoff.Next();
    EXPECT_GE(wait.count(), nominal * 3 / 4);
    EXPECT_LE(wait.count(), nominal * 5 / 4);
  }
}

TEST(Backoff, StartsAnewAfterASuccess) {
  Backoff backoff(PlcLimits{}, 7);
  for (int i = 0; i < 5; ++i) static_cast<void>(backoff.Next());
  backoff.Reset();
  EXPECT_LE(backoff.Next(), 625ms);
}

TEST(Backoff, SeedsDiffer) {
  Backoff one(PlcLimits{}, 1), other(PlcLimits{}, 2);
  EXPECT_NE(one.Longest(), other.Longest());
}

TEST(Backoff, SameSeedSameWaits) {
  Backoff one(PlcLimits{}, 1), other(PlcLimits{}, 1);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(one.Next(), other.Next());
}

}  // namespace
}  // namespace granary
