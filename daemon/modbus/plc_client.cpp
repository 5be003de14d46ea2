// One thread that may block on the PLC and on nothing else. It takes turns: connect, push what is due, read book data.
// A turn that the connection does not survive ends it; the next one comes after a growing wait. What is pushed is
// looked up when its turn comes, so an outage leaves nothing to catch up with.
#include "daemon/modbus/plc_client.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <utility>

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include "daemon/fault_log.h"
#include "daemon/modbus/plc_book.h"
#include "daemon/modbus/plc_link.h"

namespace granary {
namespace {

using Steady = std::chrono::steady_clock;
using SteadyTime = Steady::time_point;

/// A rejected commit is tried again after so long: what kept the daemon from storing it may be over.
constexpr std::chrono::hours kRejectedAgain{1};

std::string Joined(const std::vector<std::string>& parts, const char* before_each, const char* between) {
  std::string text;
  for (const auto& part : parts) text += (text.empty() ? "" : between) + (before_each + part);
  return text;
}

ModbusPlcOptions Checked(const ModbusPlcOptions& options, std::size_t bins) {
  std::vector<std::string> faults = PlcFaults(options, bins);
  if (!ParseHostPort(options.address)) faults.emplace_back("address: must be HOST:PORT or [IPV6]:PORT");
  if (bins == 0) faults.emplace_back("no bins to push");
  if (!faults.empty()) throw std::invalid_argument(Joined(faults, "modbus.plc.", "\n"));
  return options;
}

std::string Hex(std::uint16_t word) { return fmt::format("0x{:04X}", word); }

}  // namespace

/// What the client's thread owns, and the newest snapshots, which it shares.
class PlcClient::Loop {
 public:
  Loop(const ModbusPlcOptions& options, const std::vector<Bin>& bins, ModbusIdentity identity, BinControl& control,
       ModbusTally& tally, std::function<UtcTime()> utc_now, const PlcLimits& limits, std::uint32_t seed)
      : options_(Checked(options, bins.size())),
        end_point_(*ParseHostPort(options.address)),
        name_("plc " + options.address),
        block_(LayOutPlcBlock(options.fields)),
        identity_(std::move(identity)),
        control_(control),
        tally_(tally),
        utc_now_(utc_now ? std::move(utc_now) : [] { return UtcTime(std::chrono::system_clock::now()); }),
        agenda_(bins.size(), options.heartbeat, limits, seed),
        backoff_(limits, seed),
        newest_(bins.size()) {
    for (const auto& bin : bins) bins_.push_back({.id = bin.id});
  }
  ~Loop() { tally_.plc_connected = 0; }
  Loop(const Loop&) = delete;
  Loop& operator=(const Loop&) = delete;

  void Store(const BinSnapshot& snapshot) {
    const auto bin = std::find_if(bins_.begin(), bins_.end(), [&](const auto& b) { return b.id == snapshot.bin.id; });
    if (bin == bins_.end()) return;
    auto next = std::make_shared<const BinSnapshot>(snapshot);
    {
      const std::scoped_lock lock(mutex_);
      newest_[static_cast<std::size_t>(bin - bins_.begin())].swap(next);
      has_news_ = true;
    }
    wake_.notify_one();
  }

  void Run(const std::stop_token& stop) {
    while (AwaitWork(stop)) {
      try {
        HaveLink(stop);
        PushDue();
        ReadBooks(stop);
        Succeed();
      } catch (const std::runtime_error& error) {
        if (!stop.stop_requested()) Lose(error.what());
      }
    }
  }

 private:
  /// What is known of one bin besides its snapshot.
  struct BinState {
    int id = 0;                             ///< never changes; the rest belongs to the thread
    FaultLog fault = {};                    ///< of its block
    std::string book_said = {};             ///< newest log line about its book data
    std::optional<PlcBook> committed = {};  ///< newest book data of the PLC that the daemon was given
    SteadyTime committed_at = {};
  };

  /// Blocks until something is due, and the PLC may be tried. @return false when the end is wanted
  bool AwaitWork(const std::stop_token& stop) {
    constexpr std::chrono::hours kLookUp{1};  // Time::max() would overflow in the wait
    std::unique_lock lock(mutex_);
    while (!stop.stop_requested()) {
      const SteadyTime now = Steady::now();
      const SteadyTime at = std::max(retry_at_, std::min(agenda_.NextAt(newest_), NextBooksAt()));
      if (at <= now) return true;
      has_news_ = false;
      wake_.wait_until(lock, stop, std::min(at, now + kLookUp), [this] { return has_news_; });
    }
    return false;
  }

  /// With the lock held.
  [[nodiscard]] SteadyTime NextBooksAt() const {
    const bool any = options_.book_base && std::any_of(newest_.begin(), newest_.end(), [](const auto& newest) {
                       return newest && newest->book.writable;
                     });
    return any ? books_at_ : SteadyTime::max();
  }

  [[nodiscard]] NewestSnapshots Newest() const {
    const std::scoped_lock lock(mutex_);
    return newest_;
  }

  void HaveLink(const std::stop_token& stop) {
    if (link_ && link_->WasClosed()) Drop();
    if (link_) return;
    link_ = std::make_unique<PlcLink>(end_point_, options_.unit, options_.timeout, stop);
    tally_.plc_connected = 1;
    agenda_.ConnectedAnew();
    if (!std::exchange(said_where_, true)) {
      const int last = options_.base + (static_cast<int>(bins_.size()) - 1) * options_.stride + block_.words - 1;
      spdlog::info("{}: connected; the blocks of {} bins go to its holding registers {} to {}, {} each", name_,
                   bins_.size(), options_.base, last, block_.words);
    }
  }

  void Drop() {
    link_.reset();
    tally_.plc_connected = 0;
  }

  void Lose(const std::string& words) {
    Drop();
    ++tally_.plc_failures;
    const SteadyTime now = Steady::now();
    retry_at_ = now + backoff_.Next();
    if (link_fault_.Raise(words, now)) spdlog::warn("{}: {}; trying again", name_, words);
  }

  /// Only a whole turn counts: a PLC that takes one block of several each time it is connected is in trouble.
  void Succeed() {
    backoff_.Reset();
    if (link_fault_.Clear()) spdlog::info("{}: works again", name_);
  }

  /// Each due bin once, so that one that is measured all the time does not keep the others waiting.
  void PushDue() {
    for (const std::size_t bin : agenda_.Due(Newest(), Steady::now())) Push(bin, *Newest()[bin]);
  }

  void Push(std::size_t bin, const BinSnapshot& snapshot) {
    BinState& state = bins_[bin];
    const int base = options_.base + static_cast<int>(bin) * options_.stride;
    const auto words = EncodePlcBlock(block_, {snapshot, utc_now_(), identity_, tally_.Read()}, options_.byte_order);
    try {
      for (const auto& write : block_.writes) {
        link_->Write(base + write.offset, std::span(words).subspan(static_cast<std::size_t>(write.offset),
                                                                   static_cast<std::size_t>(write.words)));
      }
      if (options_.read_back) ReadBack(base, words);
    } catch (const PlcRefusal& refusal) {
      ++tally_.plc_failures;
      const SteadyTime now = Steady::now();
      agenda_.Refused(bin, refusal.lasting(), now);
      if (state.fault.Raise(refusal.what(), now)) spdlog::error("{}: bin {}: {}", name_, state.id, refusal.what());
      return;
    }
    agenda_.Taken(bin, snapshot, Steady::now());
    ++tally_.plc_pushes;
    tally_.plc_pushed_at =
        static_cast<std::uint32_t>(std::chrono::floor<std::chrono::seconds>(utc_now_()).time_since_epoch().count());
    if (state.fault.Clear()) spdlog::info("{}: bin {}: the block is taken again", name_, state.id);
  }

  /// @throws PlcRefusal for the first register that is not what was written
  void ReadBack(int base, const std::vector<std::uint16_t>& words) {
    for (const auto& write : block_.writes) {
      const auto read = link_->Read(base + write.offset, write.words);
      const auto written = words.begin() + write.offset;
      const auto [found, wanted] = std::mismatch(read.begin(), read.end(), written);
      if (found == read.end()) continue;
      const int offset = static_cast<int>(wanted - words.begin());
      throw PlcRefusal("holding register " + std::to_string(base + offset) + " (" + NameInPlcBlock(block_, offset) +
                           ") reads back " + Hex(*found) + ", written was " + Hex(*wanted),
                       false);
    }
  }

  void ReadBooks(const std::stop_token& stop) {
    if (!options_.book_base || Steady::now() < books_at_) return;
    books_at_ = Steady::now() + options_.book_every;
    try {
      for (std::size_t bin = 0; bin < bins_.size(); ++bin) ReadBook(bin);
      if (books_fault_.Clear()) spdlog::info("{}: its book data can be read again", name_);
    } catch (const PlcLinkError& error) {
      // Not as Lose does it: a PLC that takes blocks but does not survive a read is asked again after the interval, and
      // pushed to meanwhile.
      if (stop.stop_requested()) return;
      Drop();
      ++tally_.plc_failures;
      if (books_fault_.Raise(error.what(), Steady::now())) spdlog::warn("{}: {}; trying again", name_, error.what());
    }
  }

  void ReadBook(std::size_t bin) {
    const auto newest = Newest()[bin];
    if (!newest) return;
    if (!newest->book.writable) {
      return SayOfBook(bins_[bin], spdlog::level::warn,
                       "its book data are not read: book_source = \"file\" wins, those of the configuration stay");
    }
    const int address = *options_.book_base + static_cast<int>(bin) * kPlcBookWords;
    try {
      Weigh(bin, DecodePlcBook(link_->Read(address, kPlcBookWords), options_.byte_order));
    } catch (const PlcRefusal& refusal) {
      SayOfBook(bins_[bin], spdlog::level::err, refusal.what());
    }
  }

  void Weigh(std::size_t bin, const PlcBook& read) {
    BinState& state = bins_[bin];
    const BookState book = Newest()[bin]->book;  // after the read: a commit may have come into force meanwhile
    const PlcBookVerdict verdict = JudgePlcBook(read, book.in_force);
    const std::string shown = fmt::format("book data {} t, {} kg/m³", read.quantity_t, read.density_kg_m3);
    switch (verdict.finding) {
      case PlcBookFinding::kInForce:
        state.committed.reset();
        state.book_said.clear();
        return;
      case PlcBookFinding::kNoData:
        return SayOfBook(state, spdlog::level::warn, "gives no book data (0 or NaN for both); those in force stay");
      case PlcBookFinding::kRefused:
        return SayOfBook(state, spdlog::level::err, shown + " refused: " + Joined(verdict.faults, "", "; "));
      case PlcBookFinding::kNew:
        return Commit(state, read, verdict.book, book.commit, shown);
    }
  }

  void Commit(BinState& state, const PlcBook& read, const BookData& book, CommandResult before,
              const std::string& shown) {
    const SteadyTime now = Steady::now();
    if (before == CommandResult::kBusy) return;
    if (before == CommandResult::kRejected && state.committed == read && now - state.committed_at < kRejectedAgain) {
      return SayOfBook(state, spdlog::level::err, shown + " could not be put in force; tried again hourly");
    }
    if (!control_.CommitBook(state.id, book, name_)) {
      return SayOfBook(state, spdlog::level::warn,
                       shown + " not taken now: the bin is not ready or busy; trying again");
    }
    state.committed = read;
    state.committed_at = now;
    SayOfBook(state, spdlog::level::info, shown + " committed");
  }

  /// Once for as long as it is the same.
  void SayOfBook(BinState& state, spdlog::level::level_enum level, const std::string& words) {
    if (std::exchange(state.book_said, words) != words) spdlog::log(level, "{}: bin {}: {}", name_, state.id, words);
  }

  const ModbusPlcOptions options_;
  const HostPort end_point_;
  const std::string name_;
  const PlcBlock block_;
  const ModbusIdentity identity_;
  BinControl& control_;
  ModbusTally& tally_;
  const std::function<UtcTime()> utc_now_;

  std::vector<BinState> bins_;
  std::unique_ptr<PlcLink> link_;
  PlcAgenda agenda_;
  Backoff backoff_;
  FaultLog link_fault_, books_fault_;
  bool said_where_ = false;
  SteadyTime retry_at_ = SteadyTime::min();
  SteadyTime books_at_ = SteadyTime::min();

  mutable std::mutex mutex_;
  std::condition_variable_any wake_;
  NewestSnapshots newest_;  ///< guarded by mutex_
  bool has_news_ = false;   ///< guarded by mutex_; a snapshot came since the thread last looked
};

PlcClient::PlcClient(const ModbusPlcOptions& options, const std::vector<Bin>& bins, ModbusIdentity identity,
                     BinControl& control, ModbusTally& tally, std::function<UtcTime()> utc_now, PlcLimits limits,
                     std::uint32_t seed)
    : loop_(
          std::make_unique<Loop>(options, bins, std::move(identity), control, tally, std::move(utc_now), limits, seed)),
      thread_([loop = loop_.get()](const std::stop_token& stop) { loop->Run(stop); }) {}

PlcClient::~PlcClient() = default;

void PlcClient::Publish(const BinSnapshot& snapshot) { loop_->Store(snapshot); }

}  // namespace granary
