#include "daemon/store.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "daemon/records.h"
#include "tests/daemon/fakes.h"
#include "tests/pipeline/temporary_folder.h"

namespace granary {
namespace {

Measurement Numbered(int bin, std::uint64_t sequence, bool valid = true) {
  Measurement m = valid ? Valid(0.001 * static_cast<double>(sequence)) : Verdict(Reason::kFrameMissing);
  m.bin = bin;
  m.sequence = sequence;
  return m;
}

void Execute(const std::filesystem::path& folder, const std::string& sql) {
  SQLite::Database((folder / "records.sqlite").string(), SQLite::OPEN_READWRITE).exec(sql);
}

TEST(StateFolder, IsWhereSystemdSays) {
  setenv("STATE_DIRECTORY", "/run/one:/run/two", 1);
  EXPECT_EQ(StateFolder(), "/run/one");
  unsetenv("STATE_DIRECTORY");
  EXPECT_EQ(StateFolder(), "/var/lib/granaryd");
}

TEST(Store, IsEmptyAtFirst) {
  TemporaryFolder folder;
  const Store store(folder.path());
  EXPECT_FALSE(store.LastGood(1));
  EXPECT_EQ(store.LastSequence(1), 0U);
  EXPECT_TRUE(store.Last(10).empty());
}

TEST(Store, KeepsRecordsAcrossReopening) {
  TemporaryFolder folder;
  Store(folder.path()).Append(Numbered(1, 5));
  EXPECT_EQ(RecordLine(*Store(folder.path()).LastGood(1)), RecordLine(Numbered(1, 5)));
}

TEST(Store, FindsTheLastGoodBehindFailures) {
  TemporaryFolder folder;
  Store store(folder.path());
  for (const auto& m : {Numbered(1, 1), Numbered(1, 2), Numbered(1, 3, false)}) store.Append(m);
  EXPECT_EQ(store.LastGood(1)->sequence, 2U);
  EXPECT_EQ(store.LastSequence(1), 3U);
}

TEST(Store, KeepsBinsApart) {
  TemporaryFolder folder;
  Store store(folder.path());
  for (const auto& m : {Numbered(1, 1), Numbered(2, 9)}) store.Append(m);
  EXPECT_EQ(store.LastGood(1)->sequence, 1U);
  EXPECT_EQ(store.LastSequence(2), 9U);
}

TEST(Store, ListsTheNewestLast) {
  TemporaryFolder folder;
  Store store(folder.path());
  for (const auto& m : {Numbered(1, 1), Numbered(2, 1), Numbered(1, 2), Numbered(1, 3)}) store.Append(m);
  const auto all = store.Last(3);
  ASSERT_EQ(all.size(), 3U);
  EXPECT_EQ(all.front().bin, 2);
  EXPECT_EQ(all.back().sequence, 3U);
  EXPECT_EQ(store.Last(10, 1).size(), 3U);
}

TEST(Store, IsReadWhileAnotherWrites) {
  TemporaryFolder folder;
  Store writer(folder.path());
  const Store reader(folder.path(), Store::Access::kRead);
  writer.Append(Numbered(1, 1));
  EXPECT_EQ(reader.LastSequence(1), 1U);
}

TEST(Store, CannotBeReadWhereThereIsNone) {
  TemporaryFolder folder;
  EXPECT_THROW(Store(folder.path(), Store::Access::kRead), StoreError);
}

TEST(Store, NamesTheFolderThatCannotBeMade) {
  TemporaryFolder folder;
  const auto blocked = folder.Write("blocked", "a file where a folder should be") / "state";
  try {
    Store store(blocked);
    FAIL() << "opened";
  } catch (const StoreError& error) {
    EXPECT_NE(std::string(error.what()).find(blocked.string()), std::string::npos) << error.what();
  }
}

TEST(Store, RefusesAFileThatIsNoDatabase) {
  TemporaryFolder folder;
  folder.Write("records.sqlite", std::string(4096, 'x'));
  EXPECT_THROW(Store(folder.path()), StoreError);
}

TEST(Store, RefusesASchemaOfLaterVersions) {
  TemporaryFolder folder;
  { const Store store(folder.path()); }
  Execute(folder.path(), "UPDATE schema SET version = 3");
  EXPECT_THROW(Store(folder.path()), StoreError);
}

TEST(Store, CallsADamagedRecordByItsName) {
  TemporaryFolder folder;
  Store store(folder.path());
  store.Append(Numbered(1, 1));
  Execute(folder.path(), "UPDATE measurements SET record = '{'");
  EXPECT_THROW(static_cast<void>(store.LastGood(1)), StoreError);
}

TEST(Records, GiveSequenceNumbersThatGoOn) {
  TemporaryFolder folder;
  FakeClock clock;
  Measurement m = Numbered(1, 0);
  Records(folder.path(), clock).Append(m);
  Records(folder.path(), clock).Append(m);
  EXPECT_EQ(m.sequence, 2U);
}

TEST(Records, CountOnWithoutAStore) {
  TemporaryFolder folder;
  FakeClock clock;
  Records records(folder.Write("blocked", "a file where a folder should be"), clock);
  Measurement m = Numbered(1, 0);
  records.Append(m);
  records.Append(m);
  EXPECT_EQ(m.sequence, 2U);
  EXPECT_FALSE(records.LastGood(1));
}

TEST(Records, KeepAgainWhenTheStoreIsBack) {
  TemporaryFolder folder;
  FakeClock clock;
  const auto blocked = folder.Write("state", "a file where a folder should be");
  Records records(blocked, clock);
  Measurement m = Numbered(1, 0);
  records.Append(m);
  std::filesystem::remove(blocked);
  records.Append(m);
  EXPECT_EQ(records.LastGood(1)->sequence, 2U);
}

TEST(Records, SpeakOnceOfADiskThatIsFull) {
  TemporaryFolder folder;
  FakeClock clock;
  Records records(folder.path(), clock);
  Measurement m = Numbered(1, 0);
  records.Append(m);
  // A full disk can be read and not written, as a table behind this trigger.
  Execute(folder.path(),
          "CREATE TRIGGER full BEFORE INSERT ON measurements BEGIN SELECT RAISE(FAIL, 'disk full'); END");
  testing::internal::CaptureStdout();
  records.Append(m);
  records.Append(m);
  EXPECT_TRUE(records.LastGood(1));
  const std::string log = testing::internal::GetCapturedStdout();
  EXPECT_EQ(log.find("RECORDS ARE NOT BEING KEPT"), log.rfind("RECORDS ARE NOT BEING KEPT")) << log;
  EXPECT_EQ(log.find("kept again"), std::string::npos) << log;
}

TEST(Records, SurviveAStoreThatRefusesToAppend) {
  TemporaryFolder folder;
  FakeClock clock;
  Records records(folder.path(), clock);
  Measurement m = Numbered(1, 0);
  records.Append(m);
  Execute(folder.path(), "DROP TABLE measurements");
  records.Append(m);
  EXPECT_EQ(m.sequence, 2U);
}

}  // namespace
}  // namespace granary
