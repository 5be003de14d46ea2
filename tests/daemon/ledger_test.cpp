#include "daemon/ledger.h"

#include <gtest/gtest.h>

#include <SQLiteCpp/SQLiteCpp.h>

#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <future>
#include <thread>

#include "tests/daemon/fakes.h"
#include "tests/pipeline/temporary_folder.h"

namespace granary {
namespace {

constexpr const char* kVersion1 =
    "CREATE TABLE schema (version INTEGER NOT NULL); INSERT INTO schema VALUES (1);"
    "CREATE TABLE measurements (id INTEGER PRIMARY KEY, bin INTEGER NOT NULL, sequence INTEGER NOT NULL,"
    " utc_ns INTEGER NOT NULL, valid INTEGER NOT NULL, record TEXT NOT NULL);"
    "CREATE INDEX measurements_by_bin ON measurements (bin, valid, id);"
    "CREATE INDEX measurements_by_sequence ON measurements (bin, sequence);";

/// A file as a daemon of version 1 left it, with one record.
void WriteVersion1(const std::filesystem::path& folder) {
  SQLite::Database db((folder / "records.sqlite").string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
  db.exec("PRAGMA journal_mode = WAL");
  db.exec(kVersion1);
  Measurement m = Valid(0.019, At("2026-11-22T06:00:00Z"));
  m.sequence = 7;
  SQLite::Statement insert(db,
                           "INSERT INTO measurements (bin, sequence, utc_ns, valid, record) VALUES (1, 7, 0, 1, ?)");
  insert.bind(1, RecordLine(m));
  insert.exec();
}

int VersionOf(const std::filesystem::path& folder) {
  return SQLite::Database((folder / "records.sqlite").string()).execAndGet("SELECT version FROM schema").getInt();
}

BinState State(double book_mass_kg) {
  BinState state;
  state.book = {{.book_mass_kg = book_mass_kg, .density_kg_m3 = 750, .correction = 1.02, .loss_kg = 5},
                At("2026-11-22T06:00:00Z"),
                "tester"};
  state.format = {ByteOrder::kCdab, InvalidPolicy::kNan};
  state.inhibition = {At("2026-11-22T07:00:00Z"), "\xff somebody"};
  state.abnormal_latched = true;
  return state;
}

JournalEntry Line(const std::string& after) {
  return {.utc = At("2026-11-22T06:00:00Z"), .bin = 1, .who = "tester", .what = "book", .before = {}, .after = after};
}

TEST(Store, MakesVersion2OutOfVersion1) {
  TemporaryFolder folder;
  WriteVersion1(folder.path());
  {
    Store store(folder.path());
    EXPECT_EQ(store.LastGood(1)->sequence, 7U);
    EXPECT_FALSE(store.State(1));
    store.Keep(1, State(1000), {Line("{}")});
  }
  EXPECT_EQ(VersionOf(folder.path()), 2);
  EXPECT_EQ(Store(folder.path()).State(1)->book->data.book_mass_kg, 1000);
}

TEST(Store, ReadsVersion1AsItIs) {
  TemporaryFolder folder;
  WriteVersion1(folder.path());
  const Store store(folder.path(), Store::Access::kRead);
  EXPECT_EQ(store.Last(10).size(), 1U);
  EXPECT_FALSE(store.State(1));
  EXPECT_TRUE(store.Journal(10).empty());
  EXPECT_EQ(VersionOf(folder.path()), 1);
}

TEST(Store, KeepsEveryPartOfAState) {
  TemporaryFolder folder;
  BinState state = State(1000);
  Store(folder.path()).Keep(1, state, {});
  state.inhibition->who = "\xEF\xBF\xBD somebody";  // what is no UTF-8 is replaced
  EXPECT_EQ(Store(folder.path()).State(1), state);
}

TEST(Store, KeepsStateAndJournalTogetherOrNot) {
  TemporaryFolder folder;
  Store store(folder.path());
  store.Keep(1, State(1000), {Line("1000")});
  SQLite::Database((folder.path() / "records.sqlite").string(), SQLite::OPEN_READWRITE)
      .exec("CREATE TRIGGER full BEFORE INSERT ON states BEGIN SELECT RAISE(FAIL, 'disk full'); END");
  EXPECT_THROW(store.Keep(1, State(2000), {Line("2000")}), StoreError);
  EXPECT_EQ(store.State(1)->book->data.book_mass_kg, 1000);
  EXPECT_EQ(store.Journal(10).size(), 1U);
}

TEST(Store, LosesNeitherStateNorJournalWhenItIsKilled) {
  TemporaryFolder folder;
  { const Store made(folder.path()); }
  for (int round = 0; round < 5; ++round) {
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      Store store(folder.path());
      for (int i = 0;; ++i) store.Keep(1, State(i), {Line(std::to_string(i))});
    }
    // Long enough for some, and the kill falls anywhere between two steps of one.
    Store reader(folder.path(), Store::Access::kRead);
    const auto before = reader.Journal(100'000).size();
    while (reader.Journal(100'000).size() < before + 3) std::this_thread::sleep_for(std::chrono::milliseconds{1});
    kill(child, SIGKILL);
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    const Store store(folder.path());
    ASSERT_EQ(store.State(1)->book->data.book_mass_kg, std::stod(store.Journal(1).back().after));
  }
}

TEST(Store, RefusesAStateThatIsNone) {
  EXPECT_THROW(StateFromJson({{"format", {{"byte_order", 4}, {"invalid", 0}}}}), std::invalid_argument);
  EXPECT_THROW(StateFromJson({{"book", {{"book_mass_kg", nullptr}}}}), std::invalid_argument);
  EXPECT_THROW(StateFromJson(nlohmann::ordered_json::array()), std::invalid_argument);
}

TEST(Records, TellAnUnreadableStateFromNone) {
  TemporaryFolder folder;
  FakeClock clock;
  EXPECT_EQ(Records(folder.path(), clock).State(1), BinState{});
  EXPECT_EQ(Records(folder.Write("blocked", "a file where a folder should be") / "state", clock).State(1), BinState{});
  folder.Write("records.sqlite", std::string(4096, 'x'));
  EXPECT_FALSE(Records(folder.path(), clock).State(1));
}

/// While it lives the process can write nothing to files, as on a full disk.
class FullDisk {
 public:
  FullDisk() {
    signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit none{.rlim_cur = 0, .rlim_max = before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &none);
  }
  ~FullDisk() { setrlimit(RLIMIT_FSIZE, &before_); }

 private:
  rlimit before_{};
};

TEST(Records, AreReadFromADiskThatIsFull) {
  TemporaryFolder folder;
  FakeClock clock;
  const auto inner = folder / "50% #1?";
  {
    Store store(inner);
    store.Append(Valid(0.019, clock.Now()));
    store.Keep(1, State(1000), {});
  }
  Records records(inner, clock);
  std::optional<BinState> state;
  std::optional<Measurement> good;
  {
    const FullDisk full;
    EXPECT_THROW(static_cast<void>(Store(inner, Store::Access::kRead).LastSequence(1)),
                 StoreError);  // the disk is full indeed
    state = records.State(1);
    good = records.LastGood(1);
  }
  ASSERT_TRUE(state && good);
  EXPECT_TRUE(state->inhibition);
  EXPECT_EQ(good->volume_m3, 0.019);
}

TEST(Store, ReadsNoFullDiskThatLostItsDaemon) {
  TemporaryFolder folder;
  Store running(folder.path());
  running.Append(Valid(0.019));
  EXPECT_THROW(Store(folder.path(), Store::Access::kReadFullDisk), StoreError);
}

TEST(Records, DoNotKnowTheRestartsWithoutAStore) {
  TemporaryFolder folder;
  FakeClock clock;
  EXPECT_FALSE(Records(folder.Write("blocked", "a file where a folder should be"), clock).Restarts());
}

TEST(Ledger, WritesInOrderAndOnAnotherThread) {
  TemporaryFolder folder;
  FakeClock clock;
  Records records(folder.path(), clock);
  std::thread::id writer;
  {
    Ledger ledger(records, 1, {});
    for (int i = 0; i < 5; ++i) {
      ledger.Post({.journal = {Line(std::to_string(i))},
                   .change = [i](BinState& state) { state = State(i); },
                   .only_if_stored = false,
                   .done = [&](bool) { writer = std::this_thread::get_id(); }});
    }
    ledger.Drain();
    EXPECT_EQ(records.State(1)->book->data.book_mass_kg, 4);
  }
  EXPECT_NE(writer, std::this_thread::get_id());
  EXPECT_EQ(Store(folder.path()).Journal(2).front().after, "3");
}

TEST(Ledger, IsFullWhenTooMuchWaits) {
  TemporaryFolder folder;
  FakeClock clock;
  Records records(folder.path(), clock);
  Ledger ledger(records, 1, {});
  std::promise<void> go;
  LedgerEntry blocking;
  blocking.change = [&go](BinState&) { go.get_future().wait(); };
  ledger.Post(std::move(blocking));
  EXPECT_FALSE(ledger.Full());
  for (int i = 0; i < 65; ++i) ledger.Post({});
  EXPECT_TRUE(ledger.Full());
  go.set_value();
  ledger.Drain();
  EXPECT_FALSE(ledger.Full());
}

}  // namespace
}  // namespace granary
