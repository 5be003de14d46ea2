// A state on disk is always one that was in force as a whole: a change that was refused is either undone or written
// together with the next one.
#include "daemon/ledger.h"

#include <spdlog/spdlog.h>

#include <chrono>
#include <utility>

namespace granary {
namespace {

constexpr std::chrono::seconds kTryAgain{10};
constexpr std::size_t kCapacity = 64;
constexpr std::size_t kMaxUnwritten = 1000;  // journal lines that wait for a disk

}  // namespace

Ledger::Ledger(Records& records, int bin, BinState state)
    : records_(records),
      bin_(bin),
      state_(std::move(state)),
      thread_([this](const std::stop_token& stop) { Run(stop); }) {}

Ledger::~Ledger() {
  thread_.request_stop();
  thread_.join();
}

void Ledger::Post(LedgerEntry entry) {
  {
    const std::scoped_lock lock(mutex_);
    waiting_.push_back(std::move(entry));
  }
  changed_.notify_all();
}

bool Ledger::Full() {
  const std::scoped_lock lock(mutex_);
  return waiting_.size() >= kCapacity;
}

void Ledger::Drain() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return waiting_.empty() && !writing_; });
}

void Ledger::Run(const std::stop_token& stop) {
  bool refused = false;
  std::unique_lock lock(mutex_);
  while (true) {
    const auto due = [this] { return !waiting_.empty(); };
    if (refused) {
      changed_.wait_for(lock, stop, kTryAgain, due);
    } else {
      changed_.wait(lock, stop, due);
    }
    if (waiting_.empty() && stop.stop_requested()) return;
    LedgerEntry entry;  // an empty one tries again
    if (!waiting_.empty()) {
      entry = std::move(waiting_.front());
      waiting_.pop_front();
    }
    writing_ = true;
    lock.unlock();
    Write(entry);
    refused = unsaved_;
    lock.lock();
    writing_ = false;
    changed_.notify_all();
  }
}

void Ledger::Write(LedgerEntry& entry) {
  BinState next = state_;
  if (entry.change) entry.change(next);
  std::vector<JournalEntry> journal = unwritten_;
  journal.insert(journal.end(), entry.journal.begin(), entry.journal.end());
  const bool stored = records_.Keep(bin_, next, journal);
  if (stored || !entry.only_if_stored) {
    state_ = std::move(next);
    unwritten_ = stored ? std::vector<JournalEntry>{} : std::move(journal);
    unsaved_ = !stored;
  }
  if (unwritten_.size() > kMaxUnwritten) {
    spdlog::error("bin {}: the journal loses what {} did ({}): the disk has taken nothing for too long", bin_,
                  unwritten_.front().who, unwritten_.front().what);
    unwritten_.erase(unwritten_.begin());
  }
  if (entry.done) entry.done(stored);
}

}  // namespace granary
