#include "daemon/injection.h"

#include <gtest/gtest.h>

#include "tests/daemon/depot.h"

namespace granary {
namespace {

using namespace std::chrono_literals;

std::vector<std::string> InjectVolume(BinMonitor& monitor, double volume_m3) {
  return monitor.Inject({.volume_m3 = volume_m3}, 60s, "tester");
}

TEST(Inject, PublishesAMadeUpFigureMarkedAsSuch) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(InjectVolume(*monitor, 0.5).empty());
  const BinSnapshot s = depot.publisher.snapshots.back();
  EXPECT_TRUE(s.injected);
  ASSERT_TRUE(s.good && s.last);
  EXPECT_TRUE(s.good->simulated && s.good->valid);
  EXPECT_FALSE(s.held);
  EXPECT_EQ(s.good->volume_m3, 0.5);
  EXPECT_EQ(s.good->volume_percent, 25);
  EXPECT_EQ(s.good->free_volume_m3, 1.5);
  EXPECT_EQ(s.good->level_mean_m, 0.25);
  EXPECT_EQ(s.good->mass_kg, 400);
  EXPECT_EQ(s.good->error_rate_percent, -50);
  EXPECT_EQ(s.good->abnormal, true);
  EXPECT_TRUE(s.abnormal_latched);
  EXPECT_FALSE(s.good->volume_u95_m3);
}

TEST(Inject, LetsAnErrorRateWin) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->Inject({.volume_m3 = 1, .error_rate_percent = -3.5}, 60s, "tester").empty());
  const Measurement m = *depot.publisher.snapshots.back().good;
  EXPECT_EQ(m.error_rate_percent, -3.5);
  EXPECT_NEAR(*m.mass_check_kg, 772, 1e-9);  // rounding of doubles
  EXPECT_EQ(m.abnormal, true);
}

TEST(Inject, TakesLevelAndTemperature) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->Inject({.volume_m3 = 1, .level_mean_m = 1.2, .temperature_c = 21}, 60s, "tester").empty());
  EXPECT_EQ(depot.publisher.snapshots.back().good->level_mean_m, 1.2);
  EXPECT_EQ(depot.publisher.snapshots.back().good->temperature_c, 21);
}

TEST(Inject, FailsACycleWithAReason) {
  Depot depot;
  auto monitor = depot.Monitor();
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_TRUE(monitor->Inject({.reason = Reason::kFrameMissing}, 60s, "tester").empty());
  const BinSnapshot s = depot.publisher.snapshots.back();
  EXPECT_TRUE(s.held);
  EXPECT_EQ(s.last->reason, Reason::kFrameMissing);
  EXPECT_FALSE(s.last->valid);
  EXPECT_TRUE(s.last->simulated);
  EXPECT_EQ(s.good->volume_m3, 1.0);
}

TEST(Inject, CountsOnAndBack) {
  Depot depot;
  auto monitor = depot.Monitor();
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_TRUE(InjectVolume(*monitor, 0.5).empty());
  EXPECT_EQ(SequenceOf(monitor->Published()), 2U);
  EXPECT_TRUE(InjectVolume(*monitor, 0.6).empty());
  EXPECT_EQ(SequenceOf(monitor->Published()), 3U);
  EXPECT_TRUE(monitor->EndInjection("tester"));
  EXPECT_EQ(SequenceOf(monitor->Published()), 1U);
}

TEST(Inject, EndsByItselfAndShowsTheTruthAgain) {
  Depot depot;
  auto monitor = depot.Monitor();
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_TRUE(InjectVolume(*monitor, 0.5).empty());
  depot.clock.Advance(59s);
  monitor->Supervise();
  EXPECT_TRUE(monitor->Published().injected);
  depot.clock.Advance(1s);
  monitor->Supervise();
  const BinSnapshot s = depot.publisher.snapshots.back();
  EXPECT_FALSE(s.injected);
  EXPECT_EQ(s.good->volume_m3, 1.0);
  EXPECT_FALSE(s.good->simulated);
  EXPECT_FALSE(s.abnormal_latched);
}

TEST(Inject, LetsCyclesGoOnBeneathAndStoresNothingOfIt) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(InjectVolume(*monitor, 0.5).empty());
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_EQ(depot.publisher.snapshots.back().good->volume_m3, 0.5);
  EXPECT_EQ(monitor->Snapshot().good->volume_m3, 1.0);
  const auto records = Store(depot.folder.path(), Store::Access::kRead).Last(10);
  ASSERT_EQ(records.size(), 1U);
  EXPECT_EQ(records[0].volume_m3, 1.0);
  EXPECT_EQ(records[0].sequence, 1U);
}

TEST(Inject, AcknowledgesTheMadeUpAlarm) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(InjectVolume(*monitor, 0.5).empty());
  EXPECT_TRUE(monitor->Ask(BinCommand::kAcknowledge, "tester"));
  EXPECT_FALSE(depot.publisher.snapshots.back().abnormal_latched);
  EXPECT_EQ(depot.publisher.snapshots.back().good->abnormal, true);
}

TEST(Inject, DoesNotOutliveTheMonitor) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(InjectVolume(*monitor, 0.5).empty());
  monitor->Close();
  EXPECT_FALSE(depot.Monitor(monitor->Snapshot())->Published().injected);
}

TEST(Inject, IsJournaled) {
  Depot depot;
  {
    auto monitor = depot.Monitor();
    EXPECT_TRUE(InjectVolume(*monitor, 0.5).empty());
    EXPECT_TRUE(monitor->EndInjection("local uid 0"));
  }
  const auto journal = depot.Journal();
  ASSERT_EQ(journal.size(), 2U);
  EXPECT_EQ(journal[0].what, "inject");
  EXPECT_EQ(journal[0].after, R"({"seconds":60,"volume_m3":0.5})");
  EXPECT_EQ(journal[1].what, "inject_end");
  EXPECT_EQ(journal[1].who, "local uid 0");
}

TEST(Inject, WorksWhileTheBinIsInhibited) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->Ask(BinCommand::kInhibit, "tester"));
  EXPECT_TRUE(InjectVolume(*monitor, 0.5).empty());
  EXPECT_TRUE(depot.publisher.snapshots.back().injected);
  EXPECT_TRUE(depot.publisher.snapshots.back().maintenance);
}

TEST(FaultsOfInjection, NameWhatIsAllowed) {
  const auto faults = Faults(Injection{.volume_m3 = -1, .error_rate_percent = 2000}, BinSnapshot{});
  EXPECT_EQ(faults,
            (std::vector<std::string>{"volume_m3: must be 0 to 1000000", "error_rate_percent: must be -100 to 1000"}));
}

TEST(FaultsOfInjection, WantAVolumeWhereThereIsNone) {
  EXPECT_EQ(Faults(Injection{}, BinSnapshot{}).size(), 1U);
  EXPECT_TRUE(Faults(Injection{.reason = Reason::kTooDark}, BinSnapshot{}).empty());
}

TEST(Inject, RefusesATimeThatIsNone) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_EQ(monitor->Inject({.volume_m3 = 1}, 0s, "tester"), std::vector<std::string>{"seconds: must be 1 to 86400"});
}

}  // namespace
}  // namespace granary
