// The JSON record is the truth; the other columns only help to find it.
#include "daemon/store.h"

#include <SQLiteCpp/SQLiteCpp.h>

#include <algorithm>
#include <cstdlib>
#include <string>
#include <system_error>
#include <utility>

#include "daemon/record_json.h"

namespace granary {
namespace {

constexpr int kSchemaVersion = 2;
constexpr int kBusyTimeout_ms = 5000;  // a reader of another process holds the file for milliseconds

std::filesystem::path MakeFolder(const std::filesystem::path& folder, Store::Access access) {
  std::error_code error;
  if (access == Store::Access::kWrite) std::filesystem::create_directories(folder, error);
  if (error) throw StoreError("store " + folder.string() + ": create folder: " + error.message());
  return folder / "records.sqlite";
}

/// What SQLite is to open, and how.
std::string Target(const std::filesystem::path& file, Store::Access access) {
  if (access != Store::Access::kReadFullDisk) return file.string();
  std::error_code absent;
  if (const auto unmerged = std::filesystem::file_size(file.string() + "-wal", absent); !absent && unmerged > 0) {
    throw StoreError("store " + file.string() + ": open: was not closed in order");
  }
  std::string uri = "file:";
  for (const char c : file.string()) {
    // These three mean something in a URI.
    uri += c == '%' ? "%25" : c == '?' ? "%3f" : c == '#' ? "%23" : std::string(1, c);
  }
  return uri + "?immutable=1";
}

int FlagsOf(Store::Access access) {
  switch (access) {
    case Store::Access::kWrite:
      return SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE;
    case Store::Access::kReadFullDisk:
      return SQLite::OPEN_READONLY | SQLite::OPEN_URI;
    case Store::Access::kRead:
      break;
  }
  return SQLite::OPEN_READONLY;
}

nlohmann::ordered_json Parse(const std::string& text) {
  try {
    return nlohmann::ordered_json::parse(text);
  } catch (const nlohmann::json::exception& error) {
    throw std::invalid_argument(error.what());
  }
}

std::int64_t UtcNs(UtcTime utc) { return static_cast<std::int64_t>(utc.time_since_epoch().count()); }

}  // namespace

std::filesystem::path StateFolder() {
  // With several StateDirectory= entries systemd joins them with colons; ours is the first.
  const char* const value = std::getenv("STATE_DIRECTORY");
  const std::string folders = value == nullptr ? "" : value;
  const std::string first = folders.substr(0, folders.find(':'));
  return first.empty() ? std::filesystem::path("/var/lib/granaryd") : std::filesystem::path(first);
}

struct Store::Impl {
  std::filesystem::path file;
  SQLite::Database db;
  int version = 0;  ///< of the file

  Impl(const std::filesystem::path& folder, Access access)
      : file(MakeFolder(folder, access)), db(Target(file, access), FlagsOf(access), kBusyTimeout_ms) {}

  void Prepare() {
    db.exec("PRAGMA journal_mode = WAL");
    db.exec("PRAGMA synchronous = FULL");  // one row a cycle: losing none in a power cut costs nothing
    SQLite::Transaction transaction(db);
    db.exec("CREATE TABLE IF NOT EXISTS schema (version INTEGER NOT NULL)");
    if (db.execAndGet("SELECT count(*) FROM schema").getInt() == 0) {
      db.exec("INSERT INTO schema VALUES (1)");
      db.exec(
          "CREATE TABLE measurements (id INTEGER PRIMARY KEY, bin INTEGER NOT NULL, sequence INTEGER NOT NULL,"
          " utc_ns INTEGER NOT NULL, valid INTEGER NOT NULL, record TEXT NOT NULL)");
      db.exec("CREATE INDEX measurements_by_bin ON measurements (bin, valid, id)");
      db.exec("CREATE INDEX measurements_by_sequence ON measurements (bin, sequence)");
    }
    if (db.execAndGet("SELECT max(version) FROM schema").getInt() == 1) {
      db.exec("CREATE TABLE states (bin INTEGER PRIMARY KEY, state TEXT NOT NULL)");
      db.exec(
          "CREATE TABLE journal (id INTEGER PRIMARY KEY, utc_ns INTEGER NOT NULL, bin INTEGER NOT NULL,"
          " who TEXT NOT NULL, what TEXT NOT NULL, before TEXT, after TEXT)");
      db.exec("CREATE TABLE daemon (starts INTEGER NOT NULL)");
      db.exec("INSERT INTO daemon VALUES (0)");
      db.exec("UPDATE schema SET version = 2");
    }
    transaction.commit();
  }

  void CheckVersion() {
    version = db.execAndGet("SELECT max(version) FROM schema").getInt();
    if (version < 1 || version > kSchemaVersion) {
      throw StoreError("store " + file.string() + ": its schema is version " + std::to_string(version) +
                       ", this program knows versions 1 to " + std::to_string(kSchemaVersion));
    }
  }
};

namespace {

/// Runs `work`; SQLite's exceptions and damaged records come out as StoreError.
template <typename Work>
auto Guarded(const std::filesystem::path& file, const char* operation, Work work) {
  try {
    return work();
  } catch (const SQLite::Exception& error) {
    throw StoreError("store " + file.string() + ": " + operation + ": " + error.what());
  } catch (const std::invalid_argument& error) {
    throw StoreError("store " + file.string() + ": " + operation + ": damaged record: " + error.what());
  }
}

}  // namespace

Store::Store(const std::filesystem::path& folder, Access access) {
  Guarded(folder / "records.sqlite", "open", [&] {
    impl_ = std::make_unique<Impl>(folder, access);
    if (access == Access::kWrite) impl_->Prepare();
    impl_->CheckVersion();
  });
}

Store::~Store() = default;

void Store::Append(const Measurement& measurement) {
  const std::scoped_lock lock(mutex_);
  Guarded(impl_->file, "append", [&] {
    SQLite::Statement insert(impl_->db,
                             "INSERT INTO measurements (bin, sequence, utc_ns, valid, record) VALUES (?, ?, ?, ?, ?)");
    insert.bind(1, measurement.bin);
    insert.bind(2, static_cast<std::int64_t>(measurement.sequence));
    insert.bind(3, UtcNs(measurement.utc));
    insert.bind(4, measurement.valid ? 1 : 0);
    insert.bind(5, RecordLine(measurement));
    insert.exec();
  });
}

std::optional<Measurement> Store::LastGood(int bin) const {
  const std::scoped_lock lock(mutex_);
  return Guarded(impl_->file, "read", [&]() -> std::optional<Measurement> {
    SQLite::Statement query(impl_->db,
                            "SELECT record FROM measurements WHERE bin = ? AND valid = 1 ORDER BY id DESC LIMIT 1");
    query.bind(1, bin);
    if (!query.executeStep()) return std::nullopt;
    return RecordFromJson(Parse(query.getColumn(0).getString()));
  });
}

std::uint64_t Store::LastSequence(int bin) const {
  const std::scoped_lock lock(mutex_);
  return Guarded(impl_->file, "read", [&]() -> std::uint64_t {
    SQLite::Statement query(impl_->db, "SELECT ifnull(max(sequence), 0) FROM measurements WHERE bin = ?");
    query.bind(1, bin);
    query.executeStep();
    return static_cast<std::uint64_t>(query.getColumn(0).getInt64());
  });
}

std::vector<Measurement> Store::Last(std::size_t count, std::optional<int> bin) const {
  const std::scoped_lock lock(mutex_);
  return Guarded(impl_->file, "read", [&] {
    SQLite::Statement query(impl_->db,
                            "SELECT record FROM measurements WHERE ?1 IS NULL OR bin = ?1 ORDER BY id DESC LIMIT ?2");
    if (bin) query.bind(1, *bin);  // an unbound parameter is NULL
    query.bind(2, static_cast<std::int64_t>(count));
    std::vector<Measurement> records;
    while (query.executeStep()) records.push_back(RecordFromJson(Parse(query.getColumn(0).getString())));
    std::reverse(records.begin(), records.end());
    return records;
  });
}

void Store::Keep(int bin, const BinState& state, const std::vector<JournalEntry>& entries) {
  const std::scoped_lock lock(mutex_);
  Guarded(impl_->file, "keep the state", [&] {
    SQLite::Transaction transaction(impl_->db);
    for (const auto& entry : entries) {
      SQLite::Statement insert(impl_->db,
                               "INSERT INTO journal (utc_ns, bin, who, what, before, after) VALUES (?, ?, ?, ?, ?, ?)");
      insert.bind(1, UtcNs(entry.utc));
      insert.bind(2, entry.bin);
      insert.bind(3, entry.who);
      insert.bind(4, entry.what);
      if (!entry.before.empty()) insert.bind(5, entry.before);  // an unbound parameter is NULL
      if (!entry.after.empty()) insert.bind(6, entry.after);
      insert.exec();
    }
    SQLite::Statement replace(impl_->db,
                              "INSERT INTO states (bin, state) VALUES (?, ?)"
                              " ON CONFLICT (bin) DO UPDATE SET state = excluded.state");
    replace.bind(1, bin);
    replace.bind(2, StateToJson(state).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
    replace.exec();
    transaction.commit();
  });
}

std::optional<BinState> Store::State(int bin) const {
  const std::scoped_lock lock(mutex_);
  return Guarded(impl_->file, "read the state", [&]() -> std::optional<BinState> {
    if (impl_->version < 2) return std::nullopt;
    SQLite::Statement query(impl_->db, "SELECT state FROM states WHERE bin = ?");
    query.bind(1, bin);
    if (!query.executeStep()) return std::nullopt;
    return StateFromJson(Parse(query.getColumn(0).getString()));
  });
}

std::vector<JournalEntry> Store::Journal(std::size_t count, std::optional<int> bin) const {
  const std::scoped_lock lock(mutex_);
  return Guarded(impl_->file, "read the journal", [&] {
    std::vector<JournalEntry> entries;
    if (impl_->version < 2) return entries;
    SQLite::Statement query(impl_->db,
                            "SELECT utc_ns, bin, who, what, before, after FROM journal"
                            " WHERE ?1 IS NULL OR bin = ?1 ORDER BY id DESC LIMIT ?2");
    if (bin) query.bind(1, *bin);
    query.bind(2, static_cast<std::int64_t>(count));
    while (query.executeStep()) {
      entries.push_back({UtcTime{UtcTime::duration{query.getColumn(0).getInt64()}}, query.getColumn(1).getInt(),
                         query.getColumn(2).getString(), query.getColumn(3).getString(), query.getColumn(4).getString(),
                         query.getColumn(5).getString()});
    }
    std::reverse(entries.begin(), entries.end());
    return entries;
  });
}

std::uint32_t Store::CountStart() {
  const std::scoped_lock lock(mutex_);
  return Guarded(impl_->file, "count the start", [&] {
    SQLite::Transaction transaction(impl_->db);
    impl_->db.exec("UPDATE daemon SET starts = starts + 1");
    const auto starts = static_cast<std::uint32_t>(impl_->db.execAndGet("SELECT starts FROM daemon").getInt64());
    transaction.commit();
    return starts;
  });
}

}  // namespace granary
