// The half of BinMonitor that clients drive: each change is taken to the ledger and into the snapshot as one step, so
// that what is published, what is written down and the order of both agree.
#include <spdlog/spdlog.h>

#include <utility>

#include "daemon/bin_lines.h"
#include "daemon/bin_monitor.h"

namespace granary {
namespace {

constexpr std::chrono::seconds kLongestInjection{std::chrono::hours{24}};

bool IsBusy(const BinSnapshot& snapshot) { return snapshot.command.result == CommandResult::kBusy; }

}  // namespace

bool BinMonitor::Ask(BinCommand command, const std::string& who) {
  switch (command) {
    case BinCommand::kNone:
    case BinCommand::kMeasure:
      return AskAtOnce(command, who);
    case BinCommand::kAcknowledge:
      return AskAcknowledge(who);
    case BinCommand::kInhibit:
      return AskInhibit(who);
    case BinCommand::kRelease:
      return AskRelease(who);
  }
  return false;
}

bool BinMonitor::AskAtOnce(BinCommand command, const std::string& who) {
  bool rejected = false;
  {
    const std::scoped_lock lock(mutex_);
    if (!taking_ || IsBusy(snapshot_)) return false;
    if (command == BinCommand::kNone) {
      snapshot_.command = {};
    } else {
      rejected = snapshot_.maintenance;
      measure_asked_ = !rejected;
      snapshot_.command = {command, rejected ? CommandResult::kRejected : CommandResult::kBusy};
    }
    PublishSnapshot();
  }
  if (command == BinCommand::kNone) return true;
  spdlog::info("{}: a measurement is asked for by {}{}", NameOf(setup_.bin), who,
               rejected ? ", and rejected: the bin is inhibited" : "");
  Wake();
  return true;
}

bool BinMonitor::AskAcknowledge(const std::string& who) {
  const bool taken = Change([&](BinSnapshot& s, LedgerEntry& entry) {
    if (IsBusy(s)) return false;
    entry.journal = {Journal(who, "acknowledge")};
    entry.change = [](BinState& state) { state.abnormal_latched = false; };
    entry.journal.front().before =
        s.abnormal_latched ? R"({"abnormal_latched":true})" : R"({"abnormal_latched":false})";
    entry.journal.front().after = R"({"abnormal_latched":false})";
    s.abnormal_latched = false;
    if (injected_) injected_->abnormal_latched = false;
    s.command = {BinCommand::kAcknowledge, CommandResult::kDone};
    return true;
  });
  if (taken) spdlog::info("{}: alarms are acknowledged by {}", NameOf(setup_.bin), who);
  return taken;
}

bool BinMonitor::AskInhibit(const std::string& who) {
  const bool taken = Change([&](BinSnapshot& s, LedgerEntry& entry) {
    if (IsBusy(s)) return false;
    s.command = {BinCommand::kInhibit, CommandResult::kBusy};
    s.maintenance = true;
    s.next_at.reset();
    inhibit_stored_.reset();
    entry.journal = {Journal(who, "inhibit")};
    entry.change = [utc = clock_.Now(), who](BinState& state) { state.inhibition = {utc, who}; };
    entry.done = [this](bool stored) {
      if (!stored) {
        spdlog::error("{}: inhibited, but not on disk: a restart would measure again", NameOf(setup_.bin));
      }
      Update([&](BinSnapshot& now) {
        inhibit_stored_ = stored;
        SettleInhibit(now);
      });
    };
    return true;
  });
  if (!taken) return false;
  spdlog::warn("{}: inhibited by {}", NameOf(setup_.bin), who);
  Wake(/*end_cycle=*/true);
  return true;
}

bool BinMonitor::AskRelease(const std::string& who) {
  return Change([&](BinSnapshot& s, LedgerEntry& entry) {
    if (IsBusy(s)) return false;
    s.command = {BinCommand::kRelease, CommandResult::kBusy};
    entry.journal = {Journal(who, "release")};
    entry.change = [](BinState& state) { state.inhibition.reset(); };
    entry.done = [this, who](bool stored) {
      Update([](BinSnapshot& now) {
        now.maintenance = false;
        now.command.result = CommandResult::kDone;
      });
      spdlog::warn("{}: released by {}{}", NameOf(setup_.bin), who,
                   stored ? "" : ", but not on disk: after a restart it would rest again");
      Wake();
    };
    return true;
  });
}

void BinMonitor::SettleInhibit(BinSnapshot& snapshot) const {
  if (snapshot.command != CommandState{BinCommand::kInhibit, CommandResult::kBusy}) return;
  if (resting_ && inhibit_stored_) {
    snapshot.command.result = *inhibit_stored_ ? CommandResult::kDone : CommandResult::kRejected;
  }
}

bool BinMonitor::CommitBook(const BookData& book, const std::string& who) {
  const std::vector<std::string> faults = Faults(book);
  const bool taken = Change([&](BinSnapshot& s, LedgerEntry& entry) {
    if (!s.book.writable || s.book.commit == CommandResult::kBusy) return false;
    // What is on disk and in force already costs no write: clients may commit on a timer.
    s.book.commit = !faults.empty()        ? CommandResult::kRejected
                    : client_book_ == book ? CommandResult::kDone
                                           : CommandResult::kBusy;
    if (s.book.commit != CommandResult::kBusy) return true;
    entry.journal = {Journal(who, "book")};
    entry.journal.front().before = BookToJson(s.book.in_force).dump();
    entry.journal.front().after = BookToJson(WithBook({}, book)).dump();
    entry.change = [book, who, utc = clock_.Now()](BinState& state) { state.book = {book, utc, who}; };
    entry.only_if_stored = true;
    entry.done = [this, book, who](bool stored) {
      Update([&](BinSnapshot& now) {
        now.book.commit = stored ? CommandResult::kDone : CommandResult::kRejected;
        if (!stored) return;
        client_book_ = book;
        now.book.in_force = WithBook(now.book.in_force, book);
      });
      const std::string words = BookToJson(WithBook({}, book)).dump();
      if (stored) {
        spdlog::info("{}: book data of {} are in force: {}", NameOf(setup_.bin), who, words);
      } else {
        spdlog::error("{}: book data of {} are rejected, they cannot be stored: {}", NameOf(setup_.bin), who, words);
      }
    };
    return true;
  });
  if (taken && !faults.empty()) {
    spdlog::error("{}: book data of {} are rejected: {}", NameOf(setup_.bin), who, faults.front());
  }
  return taken;
}

bool BinMonitor::SetFormat(const RegisterFormat& format, const std::string& who) {
  bool news = false;
  const bool taken = Change([&](BinSnapshot& s, LedgerEntry& entry) {
    news = s.format != format;
    if (!news) return true;
    entry.journal = {Journal(who, "format")};
    entry.journal.front().before = FormatToJson(s.format).dump();
    entry.journal.front().after = FormatToJson(format).dump();
    entry.change = [format](BinState& state) { state.format = format; };
    s.format = format;
    return true;
  });
  if (taken && news) {
    spdlog::info("{}: the registers' format is set by {}: {}", NameOf(setup_.bin), who, FormatToJson(format).dump());
  }
  return taken;
}

std::vector<std::string> BinMonitor::Inject(const Injection& injection, std::chrono::seconds duration,
                                            const std::string& who) {
  std::vector<std::string> faults;
  if (duration < std::chrono::seconds{1} || duration > kLongestInjection) {
    faults.emplace_back("seconds: must be 1 to 86400");
  }
  const bool taken = Change([&](BinSnapshot& s, LedgerEntry& entry) {
    const auto more = Faults(injection, s);
    faults.insert(faults.end(), more.begin(), more.end());
    if (!faults.empty()) return false;
    entry.journal = {Journal(who, "inject")};
    entry.journal.front().after = InjectionToJson(injection, duration).dump();
    injected_ = MakeUp(injection, s, clock_.Now(), SequenceOf(ToPublish()) + 1, who);
    injected_until_ = clock_.Steady() + duration;
    return true;
  });
  if (!taken && faults.empty()) faults.emplace_back("not now: the bin is not ready, or its disk is too slow");
  if (taken) {
    spdlog::warn("{}: a MADE-UP figure is published for {} s, by {}", NameOf(setup_.bin), duration.count(), who);
  }
  return faults;
}

bool BinMonitor::EndInjection(const std::string& who) {
  const std::scoped_lock lock(mutex_);
  if (!injected_) return false;
  DropInjection(who);
  PublishSnapshot();
  return true;
}

void BinMonitor::DropInjection(const std::string& who) {
  injected_.reset();
  spdlog::warn("{}: the made-up figure is gone, ended by {}", NameOf(setup_.bin), who);
  LedgerEntry entry;
  entry.journal = {Journal(who, "inject_end")};
  ledger_->Post(std::move(entry));
}

bool BinMonitor::Change(const std::function<bool(BinSnapshot&, LedgerEntry&)>& change) {
  const std::scoped_lock lock(mutex_);
  LedgerEntry entry;
  if (!taking_ || ledger_->Full() || !change(snapshot_, entry)) return false;
  if (!entry.journal.empty()) ledger_->Post(std::move(entry));
  PublishSnapshot();
  return true;
}

JournalEntry BinMonitor::Journal(const std::string& who, std::string what) const {
  return {.utc = clock_.Now(), .bin = setup_.bin.id, .who = who, .what = std::move(what), .before = {}, .after = {}};
}

void BinMonitor::Wake(bool end_cycle) {
  std::stop_source cycle(std::nostopstate), wake(std::nostopstate);
  {
    const std::scoped_lock lock(mutex_);
    wake = wake_;
    if (end_cycle) cycle = cycle_halt_;
  }
  wake.request_stop();
  cycle.request_stop();
}

}  // namespace granary
