#include "daemon/bin_monitor.h"

#include <gtest/gtest.h>

#include <deque>

#include "daemon/bin_lines.h"
#include "daemon/worker.h"
#include "tests/daemon/fakes.h"
#include "tests/pipeline/temporary_folder.h"

namespace granary {
namespace {

using namespace std::chrono_literals;

/// One bin with one fake rig, whose verdicts are scripted (0.019 m³ when the script is at its end).
struct Depot {
  TemporaryFolder folder;
  FakeClock clock;
  Records records{folder.path(), clock};
  FakePublisher publisher;
  std::shared_ptr<FakeBench> bench = std::make_shared<FakeBench>();
  std::deque<Measurement> verdicts;
  std::stop_source stop;

  BinSetup Setup() {
    BinSetup setup;
    setup.bin.id = 3;
    setup.bin.name = "bay-3";
    setup.schedule.every = 30min;
    setup.cycle.attempts = 2;
    setup.cycle.retry_delay = 2s;
    setup.rigs.emplace_back().options.projector.driver = ProjectorDriver::kSim;
    setup.configuration_hash = 0xC0FFEE;
    setup.measure = [this](const std::vector<Shot>&, const Inventory&) {
      Measurement verdict = verdicts.empty() ? Valid(0.019) : verdicts.front();
      if (!verdicts.empty()) verdicts.pop_front();
      return verdict;
    };
    return setup;
  }
  std::unique_ptr<BinMonitor> Monitor() {
    auto monitor = std::make_unique<BinMonitor>(Setup(), records, std::vector<Publisher*>{&publisher}, clock,
                                                FakeOpener(bench, clock));
    monitor->Restore();
    return monitor;
  }
  BinSnapshot Last() { return publisher.snapshots.back(); }
};

TEST(BinMonitor, PublishesAMeasurement) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->RunCycle(depot.stop.get_token()));
  const BinSnapshot last = depot.Last();
  ASSERT_TRUE(last.good);
  EXPECT_EQ(last.good->volume_m3, 0.019);
  EXPECT_EQ(last.good->bin, 3);
  EXPECT_EQ(last.good->sequence, 1U);
  EXPECT_FALSE(last.held);
  EXPECT_EQ(last.devices.pulses, 1U);
  EXPECT_EQ(last.configuration_hash, 0xC0FFEEU);
}

TEST(BinMonitor, SaysThatItIsMeasuring) {
  Depot depot;
  auto monitor = depot.Monitor();
  const std::size_t before = depot.publisher.snapshots.size();
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_TRUE(depot.publisher.snapshots.at(before).measuring);
  EXPECT_FALSE(depot.Last().measuring);
}

TEST(BinMonitor, KnowsNothingBeforeTheFirstCycle) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_FALSE(depot.Last().good);
  EXPECT_FALSE(depot.Last().held);
}

TEST(BinMonitor, HoldsTheLastGoodFigure) {
  Depot depot;
  auto monitor = depot.Monitor();
  monitor->RunCycle(depot.stop.get_token());
  const UtcTime measured = depot.Last().good->utc;
  depot.clock.Advance(30min);
  depot.bench->failing_grabs = 2;
  monitor->RunCycle(depot.stop.get_token());
  const BinSnapshot last = depot.Last();
  EXPECT_TRUE(last.held);
  EXPECT_EQ(last.good->volume_m3, 0.019);
  EXPECT_EQ(last.good->utc, measured);
  EXPECT_EQ(last.last->reason, Reason::kFrameMissing);
  EXPECT_EQ(last.last_failure, Reason::kFrameMissing);
  EXPECT_EQ(last.failures, 1U);
  EXPECT_EQ(last.cycles, 2U);
}

TEST(BinMonitor, RecoversInTheNextCycle) {
  Depot depot;
  auto monitor = depot.Monitor();
  depot.bench->failing_grabs = 2;
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_FALSE(depot.Last().good);
  depot.clock.Advance(30min);
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_TRUE(depot.Last().good);
  EXPECT_FALSE(depot.Last().held);
  EXPECT_EQ(depot.Last().last_failure, Reason::kFrameMissing);
}

TEST(BinMonitor, OpensItsRigsBeforeTheFirstCycleAndOutlivesTrouble) {
  Depot depot;
  auto monitor = depot.Monitor();
  depot.bench->failing_opens = 1;
  monitor->Open();
  EXPECT_EQ(depot.bench->opens, 1);
  depot.clock.Advance(1s);
  monitor->Idle(std::nullopt);
  EXPECT_EQ(depot.bench->opens, 2);
  EXPECT_TRUE(monitor->RunCycle(depot.stop.get_token()));
  EXPECT_TRUE(depot.Last().last->valid);
}

TEST(TryAgain, MeasuresSoonAfterADeviceIsBack) {
  Depot depot;
  auto monitor = depot.Monitor();
  depot.bench->failing_grabs = 2;
  monitor->RunCycle(depot.stop.get_token());
  ASSERT_FALSE(depot.Last().last->valid);
  EXPECT_FALSE(monitor->TryAgain(depot.stop.get_token()));  // not at once
  depot.clock.Advance(5s);
  monitor->Idle(std::nullopt);
  EXPECT_TRUE(monitor->TryAgain(depot.stop.get_token()));
  EXPECT_TRUE(depot.Last().last->valid);
  EXPECT_FALSE(depot.Last().held);
  EXPECT_FALSE(monitor->TryAgain(depot.stop.get_token()));  // the schedule again
}

TEST(TryAgain, AsksAtLeastEveryHalfMinuteAndLeavesNoTraceUntilThen) {
  Depot depot;
  auto monitor = depot.Monitor();
  depot.bench->failing_grabs = 1'000'000;
  monitor->RunCycle(depot.stop.get_token());
  const std::uint64_t sequence = depot.Last().last->sequence;
  for (int minute = 0; minute < 60; ++minute) {
    for (int second = 0; second < 60; ++second) {
      depot.clock.Advance(1s);
      monitor->Idle(std::nullopt);
      EXPECT_FALSE(monitor->TryAgain(depot.stop.get_token()));
    }
  }
  EXPECT_EQ(depot.Last().cycles, 1U);
  EXPECT_EQ(depot.Last().failures, 1U);
  EXPECT_EQ(depot.Last().last->sequence, sequence);
  EXPECT_FALSE(depot.Last().measuring);
  EXPECT_GE(depot.Last().devices.pulses, 2U + 60 * 2);
  depot.bench->failing_grabs = 0;
  bool measured = false;
  int seconds = 0;
  for (; !measured && seconds < 120; ++seconds) {
    depot.clock.Advance(1s);
    monitor->Idle(std::nullopt);
    measured = monitor->TryAgain(depot.stop.get_token());
  }
  EXPECT_TRUE(measured);
  EXPECT_LE(seconds, 60);
}

TEST(TryAgain, LeavesPoorPicturesToTheSchedule) {
  Depot depot;
  auto monitor = depot.Monitor();
  depot.verdicts = {Verdict(Reason::kCoverageLow), Verdict(Reason::kCoverageLow)};
  monitor->RunCycle(depot.stop.get_token());
  depot.clock.Advance(10min);
  EXPECT_FALSE(monitor->TryAgain(depot.stop.get_token()));
}

TEST(BinMonitor, CountsWhatDevicesDidAcrossReopenings) {
  Depot depot;
  auto monitor = depot.Monitor();
  depot.bench->failing_grabs = 1;
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_EQ(depot.Last().devices.pulses, 2U);
  EXPECT_EQ(depot.Last().devices.pairs, 1U);
  EXPECT_EQ(depot.Last().devices.missed_frames[0], 1U);
  EXPECT_EQ(depot.Last().reopened, 1U);
}

TEST(BinMonitor, RestoresTheLastGoodFigureAsHeld) {
  Depot depot;
  depot.Monitor()->RunCycle(depot.stop.get_token());
  const UtcTime measured = depot.Last().good->utc;
  depot.clock.Advance(1h);
  auto restarted = depot.Monitor();
  const BinSnapshot last = depot.Last();
  ASSERT_TRUE(last.good);
  EXPECT_TRUE(last.held);
  EXPECT_EQ(last.good->utc, measured);
  EXPECT_FALSE(last.last);
}

TEST(BinMonitor, GoesOnCountingAfterARestart) {
  Depot depot;
  depot.Monitor()->RunCycle(depot.stop.get_token());
  depot.Monitor()->RunCycle(depot.stop.get_token());
  EXPECT_EQ(depot.Last().good->sequence, 2U);
}

TEST(BinMonitor, DoesNotHoldASimulatedFigureForRealGrain) {
  Depot depot;
  Measurement simulated = Valid(0.019, depot.clock.Now());
  simulated.bin = 3;
  simulated.simulated = true;
  depot.records.Append(simulated);
  auto monitor = depot.Monitor();
  EXPECT_FALSE(depot.Last().good);
}

TEST(BinMonitor, CarriesCountersIntoANewConfiguration) {
  Depot depot;
  auto old = depot.Monitor();
  old->RunCycle(depot.stop.get_token());
  BinMonitor next(depot.Setup(), depot.records, {&depot.publisher}, depot.clock, FakeOpener(depot.bench, depot.clock));
  next.Restore(old->Snapshot());
  EXPECT_EQ(depot.Last().cycles, 1U);
  EXPECT_TRUE(depot.Last().held);
}

TEST(BinMonitor, GivesTheRateBetweenTwoFigures) {
  Depot depot;
  depot.verdicts = {Valid(0.019), Valid(0.018)};
  auto monitor = depot.Monitor();
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_FALSE(depot.Last().rate_m3_h);
  depot.clock.Advance(30min);
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_NEAR(*depot.Last().rate_m3_h, -0.002, 1e-12);  // rounding of doubles
  EXPECT_NEAR(*depot.Last().change_m3, -0.001, 1e-12);
}

TEST(BinMonitor, LatchesAnAbnormalErrorRate) {
  Depot depot;
  Measurement abnormal = Valid(0.019);
  abnormal.abnormal = true;
  depot.verdicts = {abnormal};
  auto monitor = depot.Monitor();
  monitor->RunCycle(depot.stop.get_token());
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_FALSE(depot.Last().good->abnormal.value_or(false));
  EXPECT_TRUE(depot.Last().abnormal_latched);
}

TEST(BinMonitor, CallsAnOldFigureStale) {
  Depot depot;
  auto monitor = depot.Monitor();
  monitor->RunCycle(depot.stop.get_token());
  depot.clock.Advance(90min);
  monitor->Supervise();
  EXPECT_FALSE(depot.Last().stale);
  depot.clock.Advance(1s);
  monitor->Supervise();
  EXPECT_TRUE(depot.Last().stale);
}

TEST(BinMonitor, BeatsWhileItMakesProgress) {
  Depot depot;
  auto monitor = depot.Monitor();
  monitor->Idle(std::nullopt);
  EXPECT_TRUE(monitor->Supervise());
  EXPECT_EQ(depot.Last().heartbeat, 1);
}

TEST(BinMonitor, StopsBeatingWhenItHangs) {
  Depot depot;
  auto monitor = depot.Monitor();
  monitor->Idle(std::nullopt);
  depot.clock.Advance(31s);
  EXPECT_FALSE(monitor->Supervise());
  EXPECT_EQ(depot.Last().heartbeat, 0);
}

TEST(BinMonitor, DoesNotHangWhenItHasEnded) {
  Depot depot;
  auto monitor = depot.Monitor();
  monitor->Idle(std::nullopt);
  monitor->Close();
  depot.clock.Advance(24h);
  EXPECT_TRUE(monitor->Supervise());
}

TEST(BinMonitor, GoesOnMeasuringWithoutAStore) {
  Depot depot;
  const auto blocked = depot.folder.Write("blocked", "a file where a folder should be");
  Records records(blocked / "state", depot.clock);
  BinMonitor monitor(depot.Setup(), records, {&depot.publisher}, depot.clock, FakeOpener(depot.bench, depot.clock));
  monitor.Restore();
  monitor.RunCycle(depot.stop.get_token());
  monitor.RunCycle(depot.stop.get_token());
  EXPECT_EQ(depot.Last().good->sequence, 2U);
}

TEST(Worker, RunsItsCyclesOnSchedule) {
  Depot depot;
  const UtcTime start = depot.clock.Now();
  std::mutex mutex;
  std::condition_variable changed;
  int cycles = 0;
  Worker worker(depot.Setup(), depot.records, {&depot.publisher}, depot.clock, FakeOpener(depot.bench, depot.clock),
                [&] {
                  const std::scoped_lock lock(mutex);
                  ++cycles;
                  changed.notify_all();
                });
  worker.monitor().Restore();
  worker.Start(3);
  {
    std::unique_lock lock(mutex);
    changed.wait(lock, [&] { return cycles == 3; });
  }
  worker.Stop();
  EXPECT_TRUE(worker.Done());
  EXPECT_EQ(worker.monitor().Snapshot().cycles, 3U);
  EXPECT_EQ(worker.monitor().Snapshot().good->utc, start + 60min);
}

TEST(Worker, StopsDuringABlockedGrab) {
  Depot depot;
  depot.bench->block_grab = true;
  Worker worker(depot.Setup(), depot.records, {&depot.publisher}, depot.clock, FakeOpener(depot.bench, depot.clock));
  worker.monitor().Restore();
  worker.Start();
  {
    std::unique_lock lock(depot.bench->mutex);
    depot.bench->changed.wait(lock, [&] { return depot.bench->blocked; });
  }
  worker.Stop();
  EXPECT_EQ(worker.monitor().Snapshot().cycles, 0U);
  EXPECT_EQ(depot.bench->closes, 2);
}

TEST(CycleLine, ReadsAsAPersonWantsIt) {
  Bin bin;
  bin.name = "bay-1";
  Measurement m = Valid(0.01901);
  m.volume_u95_m3 = 0.00006;
  m.mass_kg = 15020.0;
  m.error_rate_percent = -1.24;
  m.abnormal = false;
  m.coverage_percent = 97.2;
  m.timings_ms.total = 912;
  EXPECT_EQ(CycleLine(bin, m), "bin 1 bay-1: 0.01901 m³ ±0.00006, 15.02 t, error -1.2 % (ok), coverage 97 %, 0.9 s");
}

TEST(CycleLine, WeighsLittleGrainInKilograms) {
  Measurement m = Valid(0.01901);
  m.mass_kg = 15.0179;
  EXPECT_NE(CycleLine(Bin{}, m).find(", 15.02 kg,"), std::string::npos) << CycleLine(Bin{}, m);
}

TEST(CycleLine, HasNoNegativeZero) {
  Measurement m = Valid(0.01901);
  m.error_rate_percent = -0.04;
  EXPECT_NE(CycleLine(Bin{}, m).find("error +0.0 %"), std::string::npos) << CycleLine(Bin{}, m);
}

TEST(FailureLine, NamesReasonAndWhatIsHeld) {
  BinSnapshot snapshot;
  snapshot.bin.name = "bay-1";
  snapshot.last = Verdict(Reason::kProjectorDark);
  snapshot.good = Valid(0.01901, At("2026-11-22T06:00:00Z"));
  EXPECT_EQ(FailureLine(snapshot),
            "bin 1 bay-1: no figure (projector_dark): as the test wants it; held: 0.0190 m³ ±0.0001 of "
            "2026-11-22T06:00:00Z. Check the projector's supply, its trigger line and its window.");
}

}  // namespace
}  // namespace granary
