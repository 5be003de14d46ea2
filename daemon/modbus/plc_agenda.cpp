// Nothing is queued: what is due is found by comparing the newest snapshot with what the PLC took last.
#include "daemon/modbus/plc_agenda.h"

#include <algorithm>

#include "daemon/modbus/status.h"

namespace granary {
namespace {

/// Time of the newest record, failed ones too.
UtcTime NewestUtc(const BinSnapshot& snapshot) {
  UtcTime newest = UtcTime::min();
  if (snapshot.good) newest = std::max(newest, snapshot.good->utc);
  if (snapshot.last) newest = std::max(newest, snapshot.last->utc);
  return newest;
}

}  // namespace

std::chrono::milliseconds Backoff::Next() {
  std::chrono::milliseconds wait = limits_.first_retry;
  for (int i = 0; i < failures_ && wait < limits_.longest_retry; ++i) wait *= 2;
  ++failures_;
  return WithJitter(std::min(wait, limits_.longest_retry));
}

std::chrono::milliseconds Backoff::Longest() { return WithJitter(limits_.longest_retry); }

std::chrono::milliseconds Backoff::WithJitter(std::chrono::milliseconds wait) {
  std::uniform_real_distribution<double> jitter(0.75, 1.25);
  return std::chrono::round<std::chrono::milliseconds>(jitter(random_) *
                                                       std::chrono::duration<double, std::milli>(wait));
}

bool PlcNews::SameMeasurement(const PlcNews& other) const {
  return good_sequence == other.good_sequence && good_utc == other.good_utc && last_sequence == other.last_sequence &&
         last_utc == other.last_utc && injected == other.injected;
}

bool PlcNews::SameState(const PlcNews& other) const {
  return status == other.status && alarms_active == other.alarms_active && alarms_latched == other.alarms_latched &&
         invalid == other.invalid;
}

PlcNews PlcNewsOf(const BinSnapshot& snapshot) {
  PlcNews news;
  if (snapshot.good) news.good_sequence = snapshot.good->sequence, news.good_utc = snapshot.good->utc;
  if (snapshot.last) news.last_sequence = snapshot.last->sequence, news.last_utc = snapshot.last->utc;
  news.injected = snapshot.injected;
  news.status = StatusWord(snapshot);
  news.alarms_active = ActiveAlarms(snapshot);
  news.alarms_latched = LatchedAlarms(snapshot);
  news.invalid = snapshot.format.invalid;
  return news;
}

PlcAgenda::PlcAgenda(std::size_t bins, std::chrono::milliseconds heartbeat, const PlcLimits& limits, std::uint32_t seed)
    : heartbeat_(heartbeat), status_gap_(limits.status_gap) {
  for (std::size_t bin = 0; bin < bins; ++bin) {
    entries_.push_back({.taken = std::nullopt, .backoff = Backoff(limits, seed + static_cast<std::uint32_t>(bin))});
  }
}

PlcAgenda::Time PlcAgenda::DueAt(const Entry& entry, const BinSnapshot* newest) const {
  if (newest == nullptr) return Time::max();
  if (!entry.taken) return entry.not_before;
  const PlcNews news = PlcNewsOf(*newest);
  if (!news.SameMeasurement(*entry.taken)) return entry.not_before;
  const auto wait = news.SameState(*entry.taken) ? heartbeat_ : std::min(heartbeat_, status_gap_);
  return std::max(entry.taken_at + wait, entry.not_before);
}

std::vector<std::size_t> PlcAgenda::Due(const NewestSnapshots& newest, Time now) const {
  std::vector<std::size_t> due;
  for (std::size_t bin = 0; bin < entries_.size(); ++bin) {
    if (DueAt(entries_[bin], newest.at(bin).get()) <= now) due.push_back(bin);
  }
  std::stable_sort(due.begin(), due.end(),
                   [&](std::size_t a, std::size_t b) { return NewestUtc(*newest[a]) > NewestUtc(*newest[b]); });
  return due;
}

PlcAgenda::Time PlcAgenda::NextAt(const NewestSnapshots& newest) const {
  Time next = Time::max();
  for (std::size_t bin = 0; bin < entries_.size(); ++bin) {
    next = std::min(next, DueAt(entries_[bin], newest.at(bin).get()));
  }
  return next;
}

void PlcAgenda::Taken(std::size_t bin, const BinSnapshot& pushed, Time now) {
  Entry& entry = entries_.at(bin);
  entry.taken = PlcNewsOf(pushed);
  entry.taken_at = now;
  entry.not_before = Time::min();
  entry.backoff.Reset();
}

void PlcAgenda::Refused(std::size_t bin, bool lasting, Time now) {
  Entry& entry = entries_.at(bin);
  entry.taken.reset();
  entry.not_before = now + (lasting ? entry.backoff.Longest() : entry.backoff.Next());
}

void PlcAgenda::ConnectedAnew() {
  for (auto& entry : entries_) {
    entry.taken.reset();
    entry.not_before = Time::min();
  }
}

}  // namespace granary
