#include <gtest/gtest.h>

#include <SQLiteCpp/SQLiteCpp.h>

#include <atomic>
#include <thread>

#include "daemon/bin_monitor.h"
#include "daemon/worker.h"
#include "tests/daemon/depot.h"

namespace granary {
namespace {

using namespace std::chrono_literals;
using enum CommandResult;
using enum BinCommand;

void Execute(const std::filesystem::path& folder, const std::string& sql) {
  SQLite::Database((folder / "records.sqlite").string(), SQLite::OPEN_READWRITE, 5000).exec(sql);
}

/// From now on the disk takes no state of a bin.
void FillDisk(const Depot& depot) {
  Execute(depot.folder.path(),
          "CREATE TRIGGER full BEFORE INSERT ON states BEGIN SELECT RAISE(FAIL, 'disk full'); END");
}

TEST(Ask, IsRefusedBeforeTheBinIsReady) {
  Depot depot;
  BinMonitor monitor(depot.Setup(), *depot.records, {&depot.publisher}, depot.clock,
                     FakeOpener(depot.bench, depot.clock));
  EXPECT_FALSE(monitor.Ask(kMeasure, "tester"));
  EXPECT_FALSE(monitor.CommitBook(kBook, "tester"));
  EXPECT_FALSE(monitor.SetFormat({}, "tester"));
}

TEST(Ask, IsRefusedAfterTheEnd) {
  Depot depot;
  auto monitor = depot.Monitor();
  monitor->Close();
  EXPECT_FALSE(monitor->Ask(kInhibit, "tester"));
}

TEST(AskMeasure, IsBusyUntilTheFigureIsPublished) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_FALSE(monitor->TakeMeasure());
  EXPECT_TRUE(monitor->Ask(kMeasure, "tester"));
  EXPECT_EQ(monitor->Snapshot().command, (CommandState{kMeasure, kBusy}));
  EXPECT_FALSE(monitor->Ask(kAcknowledge, "tester"));  // one at a time
  EXPECT_FALSE(monitor->Ask(kNone, "tester"));
  EXPECT_TRUE(monitor->TakeMeasure());
  monitor->RunCycle(depot.stop.get_token());
  // The result and the figure come in one snapshot.
  const auto done =
      std::find_if(depot.publisher.snapshots.begin(), depot.publisher.snapshots.end(), Came(kMeasure, kDone));
  ASSERT_NE(done, depot.publisher.snapshots.end());
  EXPECT_TRUE(done->last);
  EXPECT_FALSE(monitor->TakeMeasure());
}

TEST(AskMeasure, IsDoneWithoutAFigureToo) {
  Depot depot;
  auto monitor = depot.Monitor();
  depot.bench->failing_grabs = 2;
  EXPECT_TRUE(monitor->Ask(kMeasure, "tester"));
  EXPECT_TRUE(monitor->TakeMeasure());
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_EQ(monitor->Snapshot().command, (CommandState{kMeasure, kDone}));
  EXPECT_EQ(monitor->Snapshot().last->reason, Reason::kFrameMissing);
}

TEST(AskMeasure, DuringACycleMeansAnotherOne) {
  Depot depot;
  auto monitor = depot.Monitor();
  depot.before_measuring = [&] {
    depot.before_measuring = nullptr;
    EXPECT_TRUE(monitor->Ask(kMeasure, "tester"));
  };
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_EQ(monitor->Snapshot().command, (CommandState{kMeasure, kBusy}));
  EXPECT_TRUE(monitor->TakeMeasure());
}

TEST(AskMeasure, GoesOnInTheMonitorOfANewConfiguration) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->Ask(kMeasure, "tester"));
  monitor->Close();
  auto next = depot.Monitor(monitor->Snapshot());
  EXPECT_TRUE(next->TakeMeasure());
}

TEST(AskNone, PutsTheHandshakeBack) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->Ask(kAcknowledge, "tester"));
  EXPECT_EQ(monitor->Snapshot().command, (CommandState{kAcknowledge, kDone}));
  EXPECT_TRUE(monitor->Ask(kNone, "tester"));
  EXPECT_EQ(monitor->Snapshot().command, CommandState{});
}

TEST(AskAcknowledge, TakesTheLatchAndLeavesAnActiveAlarm) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->CommitBook(kBook, "tester"));
  ASSERT_TRUE(depot.publisher.Await(Committed(kDone)));
  monitor->RunCycle(depot.stop.get_token());  // 765 kg + 5 of 1000 kg
  ASSERT_TRUE(monitor->Snapshot().abnormal_latched);
  EXPECT_TRUE(monitor->Ask(kAcknowledge, "tester"));
  EXPECT_FALSE(monitor->Snapshot().abnormal_latched);
  EXPECT_EQ(monitor->Snapshot().good->abnormal, true);
}

TEST(AskAcknowledge, IsNotForgottenByARestart) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->CommitBook(kBook, "tester"));
  ASSERT_TRUE(depot.publisher.Await(Committed(kDone)));
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_TRUE(monitor->Ask(kAcknowledge, "tester"));
  monitor->Close();
  EXPECT_FALSE(depot.Monitor()->Snapshot().abnormal_latched);
}

TEST(BinMonitor, KeepsALatchedAlarmOverARestart) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->CommitBook(kBook, "tester"));
  ASSERT_TRUE(depot.publisher.Await(Committed(kDone)));
  monitor->RunCycle(depot.stop.get_token());
  BookData fitting = kBook;
  fitting.book_mass_kg = 770;
  EXPECT_TRUE(monitor->CommitBook(fitting, "tester"));
  ASSERT_TRUE(depot.publisher.Await(
      [](const BinSnapshot& s) { return s.book.commit == kDone && s.book.in_force.book_mass_kg == 770; }));
  monitor->RunCycle(depot.stop.get_token());
  monitor->Close();
  const BinSnapshot restarted = depot.Monitor()->Snapshot();
  EXPECT_EQ(restarted.good->abnormal, false);
  EXPECT_TRUE(restarted.abnormal_latched);
}

TEST(AskInhibit, IsDoneWhenStoredAndAtRest) {
  Depot depot;
  auto monitor = depot.Monitor();
  monitor->Open();
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_TRUE(monitor->Ask(kInhibit, "tester"));
  EXPECT_TRUE(monitor->Snapshot().maintenance);  // at once
  EXPECT_EQ(depot.bench->closes, 0);
  EXPECT_EQ(monitor->Snapshot().command.result, kBusy);
  EXPECT_TRUE(monitor->RestIfInhibited());
  EXPECT_EQ(depot.bench->closes, 2);
  const auto done = depot.publisher.Await(Came(kInhibit, kDone));
  ASSERT_TRUE(done);
  EXPECT_TRUE(done->held);
  EXPECT_FALSE(done->next_at);
  EXPECT_TRUE(Store(depot.folder.path(), Store::Access::kRead).State(3)->inhibition);
}

TEST(AskInhibit, RejectsAMeasurement) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->Ask(kInhibit, "tester"));
  EXPECT_TRUE(monitor->RestIfInhibited());
  ASSERT_TRUE(depot.publisher.Await(Came(kInhibit, kDone)));
  EXPECT_TRUE(monitor->Ask(kMeasure, "tester"));
  EXPECT_EQ(monitor->Snapshot().command, (CommandState{kMeasure, kRejected}));
  EXPECT_FALSE(monitor->TakeMeasure());
}

TEST(AskInhibit, EndsTheCycleBetweenTwoCaptures) {
  Depot depot;
  BinSetup setup = depot.Setup();
  setup.rigs.push_back(setup.rigs.front());
  BinMonitor* asked = nullptr;
  int opened = 0;
  const auto open = [&](const RigOptions& options, const RigWorld& world) {
    // The first rig is being opened: its capture follows, the second rig's must not.
    if (++opened == 1) {
      EXPECT_TRUE(asked->Ask(kInhibit, "tester"));
    }
    return FakeOpener(depot.bench, depot.clock)(options, world);
  };
  BinMonitor monitor(setup, *depot.records, {&depot.publisher}, depot.clock, open);
  asked = &monitor;
  monitor.Restore();
  EXPECT_FALSE(monitor.RunCycle(depot.stop.get_token()));
  EXPECT_EQ(opened, 1);
  EXPECT_EQ(monitor.Snapshot().cycles, 0U);
  EXPECT_FALSE(monitor.Snapshot().measuring);
}

TEST(AskInhibit, StartsNoCycle) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->Ask(kInhibit, "tester"));
  EXPECT_FALSE(monitor->RunCycle(depot.stop.get_token()));
  EXPECT_EQ(depot.bench->pulses, 0);
}

TEST(AskInhibit, SurvivesARestart) {
  Depot depot;
  {
    auto monitor = depot.Monitor();
    EXPECT_TRUE(monitor->Ask(kInhibit, "tester"));
    EXPECT_TRUE(monitor->RestIfInhibited());
    ASSERT_TRUE(depot.publisher.Await(Came(kInhibit, kDone)));
  }
  depot.NewRecords();
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->Snapshot().maintenance);
  EXPECT_FALSE(monitor->RunCycle(depot.stop.get_token()));
}

TEST(AskInhibit, IsRejectedByAFullDiskAndRestsAllTheSame) {
  Depot depot;
  auto monitor = depot.Monitor();
  FillDisk(depot);
  EXPECT_TRUE(monitor->Ask(kInhibit, "tester"));
  EXPECT_TRUE(monitor->RestIfInhibited());
  const auto rejected = depot.publisher.Await(Came(kInhibit, kRejected));
  ASSERT_TRUE(rejected);
  EXPECT_TRUE(rejected->maintenance);
}

TEST(BinMonitor, RestsWhenTheStoreCannotSayWhetherItIsInhibited) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->SetFormat({ByteOrder::kCdab, InvalidPolicy::kNan}, "tester"));
  monitor.reset();
  Execute(depot.folder.path(), "UPDATE states SET state = '{'");
  EXPECT_TRUE(depot.Monitor()->Snapshot().maintenance);
}

TEST(AskRelease, MeasuresAgain) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->Ask(kInhibit, "tester"));
  EXPECT_TRUE(monitor->RestIfInhibited());
  ASSERT_TRUE(depot.publisher.Await(Came(kInhibit, kDone)));
  EXPECT_TRUE(monitor->Ask(kRelease, "tester"));
  ASSERT_TRUE(depot.publisher.Await(Came(kRelease, kDone)));
  EXPECT_FALSE(monitor->RestIfInhibited());
  EXPECT_EQ(depot.bench->opens, 1);  // trouble is known before the next scheduled time
  EXPECT_TRUE(monitor->RunCycle(depot.stop.get_token()));
  monitor->Close();
  EXPECT_FALSE(depot.Monitor()->Snapshot().maintenance);
}

TEST(CommitBook, IsInForceForTheNextMeasurement) {
  Depot depot;
  auto monitor = depot.Monitor();
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_TRUE(monitor->CommitBook(kBook, "tester"));
  const auto done = depot.publisher.Await(Committed(kDone));
  ASSERT_TRUE(done);
  EXPECT_EQ(done->book.in_force.book_mass_kg, 1000);
  EXPECT_EQ(done->good->book_mass_kg, 800);  // the published one keeps those it was compared with
  monitor->RunCycle(depot.stop.get_token());
  EXPECT_EQ(monitor->Snapshot().good->book_mass_kg, 1000);
  EXPECT_EQ(monitor->Snapshot().good->density_kg_m3, 750);
}

TEST(CommitBook, KeepsTheFilesAlarmLimit) {
  Depot depot;
  auto monitor = depot.Monitor();
  EXPECT_TRUE(monitor->CommitBook(kBook, "tester"));
  const auto done = depot.publisher.Await(Committed(kDone));
  ASSERT_TRUE(done);
  EXPECT_EQ(done->book.in_force.alarm_percent, 3.0);
}

TEST(CommitBook, SurvivesARestartAndSaysWhose) {
  Depot depot;
  {
    auto monitor = depot.Monitor();
    EXPECT_TRUE(monitor->CommitBook(kBook, "192.168.7.20:40112"));
  }
  depot.NewRecords();
  testing::internal::CaptureStdout();
  const BinSnapshot restarted = depot.Monitor()->Snapshot();
  const std::string log = testing::internal::GetCapturedStdout();
  EXPECT_EQ(restarted.book.in_force.book_mass_kg, 1000);
  EXPECT_NE(log.find("192.168.7.20:40112, since 2026-11-22T06:00:00Z"), std::string::npos) << log;
}

TEST(CommitBook, IsNotTakenWhereTheFileWins) {
  Depot depot;
  {
    auto monitor = depot.Monitor();
    EXPECT_TRUE(monitor->CommitBook(kBook, "tester"));
  }
  depot.book_source = BookSource::kFile;
  auto monitor = depot.Monitor();
  EXPECT_EQ(monitor->Snapshot().book.in_force.book_mass_kg, 800);
  EXPECT_FALSE(monitor->Snapshot().book.writable);
  EXPECT_FALSE(monitor->CommitBook(kBook, "tester"));
}

TEST(CommitBook, RejectsWhatIsOutOfRange) {
  Depot depot;
  auto monitor = depot.Monitor();
  BookData wrong = kBook;
  wrong.density_kg_m3 = 0;
  EXPECT_TRUE(monitor->CommitBook(wrong, "tester"));
  EXPECT_EQ(monitor->Snapshot().book.commit, kRejected);
  EXPECT_EQ(monitor->Snapshot().book.in_force.density_kg_m3, 800);
}

TEST(CommitBook, IsRejectedByAFullDiskAsAWhole) {
  Depot depot;
  auto monitor = depot.Monitor();
  FillDisk(depot);
  EXPECT_TRUE(monitor->CommitBook(kBook, "tester"));
  const auto rejected = depot.publisher.Await(Committed(kRejected));
  ASSERT_TRUE(rejected);
  EXPECT_EQ(rejected->book.in_force.book_mass_kg, 800);
  monitor.reset();
  EXPECT_TRUE(depot.Journal().empty());
  // Later changes do not bring it back.
  Execute(depot.folder.path(), "DROP TRIGGER full");
  auto next = depot.Monitor();
  EXPECT_TRUE(next->SetFormat({ByteOrder::kCdab, InvalidPolicy::kNan}, "tester"));
  next.reset();
  EXPECT_FALSE(Store(depot.folder.path(), Store::Access::kRead).State(3)->book);
}

TEST(CommitBook, TakesOneOfTwoAtOnce) {
  Depot depot;
  auto monitor = depot.Monitor();
  // Nothing goes to disk while this transaction is open.
  SQLite::Database other((depot.folder.path() / "records.sqlite").string(), SQLite::OPEN_READWRITE);
  other.exec("BEGIN IMMEDIATE");
  std::atomic<int> taken = 0;
  {
    std::vector<std::jthread> clients;
    for (int i = 0; i < 2; ++i) {
      clients.emplace_back([&, i] {
        BookData book = kBook;
        book.book_mass_kg += i;
        taken += monitor->CommitBook(book, "client " + std::to_string(i)) ? 1 : 0;
      });
    }
  }
  EXPECT_EQ(taken, 1);
  EXPECT_EQ(monitor->Snapshot().book.commit, kBusy);
  other.exec("ROLLBACK");
  EXPECT_TRUE(depot.publisher.Await(Committed(kDone)));
}

TEST(CommitBook, WritesNothingForWhatIsInForceAlready) {
  Depot depot;
  {
    auto monitor = depot.Monitor();
    EXPECT_TRUE(monitor->CommitBook(kBook, "tester"));
    ASSERT_TRUE(depot.publisher.Await(Committed(kDone)));
    EXPECT_TRUE(monitor->CommitBook(kBook, "tester"));
    EXPECT_EQ(monitor->Snapshot().book.commit, kDone);
  }
  EXPECT_EQ(depot.Journal().size(), 1U);
}

TEST(SetFormat, IsPublishedBeforeItReturnsAndKept) {
  Depot depot;
  const RegisterFormat format{ByteOrder::kBadc, InvalidPolicy::kMinus9999};
  {
    auto monitor = depot.Monitor();
    EXPECT_TRUE(monitor->SetFormat(format, "tester"));
    EXPECT_EQ(depot.publisher.snapshots.back().format, format);
  }
  depot.NewRecords();
  EXPECT_EQ(depot.Monitor()->Snapshot().format, format);
}

TEST(SetFormat, GoesAlongWithTheNextChangeWhenTheDiskRefusedIt) {
  Depot depot;
  const RegisterFormat format{ByteOrder::kBadc, InvalidPolicy::kMinus9999};
  {
    auto monitor = depot.Monitor();
    FillDisk(depot);
    EXPECT_TRUE(monitor->SetFormat(format, "tester"));
    EXPECT_TRUE(monitor->CommitBook(kBook, "tester"));
    ASSERT_TRUE(depot.publisher.Await(Committed(kRejected)));
    Execute(depot.folder.path(), "DROP TRIGGER full");
    EXPECT_TRUE(monitor->CommitBook(kBook, "tester"));
    ASSERT_TRUE(depot.publisher.Await(Committed(kDone)));
  }
  EXPECT_EQ(Store(depot.folder.path(), Store::Access::kRead).State(3)->format, format);
  const auto journal = depot.Journal();
  ASSERT_EQ(journal.size(), 2U);
  EXPECT_EQ(journal.front().what, "format");
  EXPECT_EQ(journal.back().what, "book");
}

TEST(BinMonitor, TakesTheConfigurationsFormatUntilAClientWritesOne) {
  Depot depot;
  BinSetup setup = depot.Setup();
  setup.format = {ByteOrder::kDcba, InvalidPolicy::kNan};
  BinMonitor monitor(setup, *depot.records, {&depot.publisher}, depot.clock, FakeOpener(depot.bench, depot.clock));
  monitor.Restore();
  EXPECT_EQ(monitor.Snapshot().format, setup.format);
}

TEST(Journal, SaysWhoChangedWhatAndWhatItWas) {
  Depot depot;
  {
    auto monitor = depot.Monitor();
    EXPECT_TRUE(monitor->CommitBook(kBook, "192.168.7.20:40112"));
  }
  const auto journal = depot.Journal();
  ASSERT_EQ(journal.size(), 1U);
  EXPECT_EQ(journal[0].utc, depot.clock.Now());
  EXPECT_EQ(journal[0].bin, 3);
  EXPECT_EQ(journal[0].who, "192.168.7.20:40112");
  EXPECT_EQ(journal[0].what, "book");
  EXPECT_EQ(journal[0].before, R"({"book_mass_kg":800.0,"density_kg_m3":800.0,"correction":1.0,"loss_kg":0.0})");
  EXPECT_EQ(journal[0].after, R"({"book_mass_kg":1000.0,"density_kg_m3":750.0,"correction":1.02,"loss_kg":5.0})");
}

TEST(BinMonitor, CountsItsRestarts) {
  Depot depot;
  EXPECT_EQ(depot.Monitor()->Snapshot().restarts, 0U);
  EXPECT_EQ(depot.Monitor()->Snapshot().restarts, 0U);  // a new configuration is no start
  depot.NewRecords();
  EXPECT_EQ(depot.Monitor()->Snapshot().restarts, 1U);
}

TEST(Worker, MeasuresAtOnceWhenAsked) {
  Depot depot;
  BinSetup setup = depot.Setup();
  setup.schedule.at = {12h};  // nothing is due for hours
  SystemClock clock;
  Worker worker(setup, *depot.records, {&depot.publisher}, clock, FakeOpener(depot.bench, clock));
  worker.monitor().Restore();
  worker.Start();
  EXPECT_TRUE(worker.monitor().Ask(kMeasure, "tester"));
  EXPECT_TRUE(depot.publisher.Await(Came(kMeasure, kDone)));
  worker.Stop();
  EXPECT_EQ(worker.monitor().Snapshot().cycles, 1U);
}

TEST(Worker, RestsWhileInhibitedAndGoesOnWhenReleased) {
  Depot depot;
  Worker worker(depot.Setup(), *depot.records, {&depot.publisher}, depot.clock, FakeOpener(depot.bench, depot.clock));
  worker.monitor().Restore();
  worker.Start();
  ASSERT_TRUE(depot.publisher.Await([](const BinSnapshot& s) { return s.cycles > 0 && !s.measuring; }));
  EXPECT_TRUE(worker.monitor().Ask(kInhibit, "tester"));
  const auto inhibited = depot.publisher.Await(Came(kInhibit, kDone));
  ASSERT_TRUE(inhibited);
  const std::uint64_t cycles = inhibited->cycles;
  // The clock goes as fast as the worker looks up: hours of schedule go by.
  const UtcTime since = depot.clock.Now();
  while (depot.clock.Now() < since + 5h) std::this_thread::yield();
  EXPECT_EQ(worker.monitor().Snapshot().cycles, cycles);
  EXPECT_TRUE(worker.monitor().Supervise());
  EXPECT_TRUE(worker.monitor().Ask(kRelease, "tester"));
  EXPECT_TRUE(depot.publisher.Await([&](const BinSnapshot& s) { return s.cycles > cycles; }));
  worker.Stop();
}

TEST(Worker, ClosesWhatACrashLeftOpenWhenItStartsInhibited) {
  Depot depot;
  {
    auto monitor = depot.Monitor();
    EXPECT_TRUE(monitor->Ask(kInhibit, "tester"));
  }
  depot.NewRecords();
  Worker worker(depot.Setup(), *depot.records, {&depot.publisher}, depot.clock, FakeOpener(depot.bench, depot.clock));
  worker.monitor().Restore();
  worker.Start();
  const UtcTime since = depot.clock.Now();
  while (depot.clock.Now() < since + 1h) std::this_thread::yield();
  worker.Stop();
  EXPECT_EQ(depot.bench->opens, 1);
  EXPECT_EQ(depot.bench->closes, 2);
  EXPECT_EQ(depot.bench->pulses, 0);
}

}  // namespace
}  // namespace granary
