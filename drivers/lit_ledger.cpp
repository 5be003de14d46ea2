// A window that ends with the pulse to come is the worst one: until then each moment adds as much as it can drop, and
// afterwards it only drops.
#include "drivers/lit_ledger.h"

#include <algorithm>
#include <cassert>
#include <map>
#include <mutex>

namespace granary {

void LitLedger::Add(Time from, Time until) {
  assert(from <= until && (spans_.empty() || spans_.back().until <= from));
  while (!spans_.empty() && spans_.front().until <= until - kWindow) spans_.pop_front();
  spans_.push_back({from, until});
}

LitLedger::Duration LitLedger::LitBetween(Time from, Time until) const {
  Duration lit{0};
  for (const Span& span : spans_) {
    lit += std::max(Duration{0}, std::min(span.until, until) - std::max(span.from, from));
  }
  return lit;
}

LitLedger::Time LitLedger::AllowedFrom(Time now, Duration width, Duration limit) const {
  const Time window_start = now + width - kWindow;
  Duration excess = LitBetween(window_start, now) + width - limit;
  if (excess <= Duration{0}) return now;
  for (const Span& span : spans_) {
    if (span.until <= window_start) continue;
    const Time from = std::max(span.from, window_start);
    if (span.until - from >= excess) return from + excess + kWindow - width;
    excess -= span.until - from;
  }
  return now + kWindow;
}

std::shared_ptr<LitLedger> LedgerOfLine(const std::string& line) {
  static std::mutex mutex;
  static std::map<std::string, std::shared_ptr<LitLedger>> ledgers;
  const std::scoped_lock lock(mutex);
  auto& ledger = ledgers[line];
  if (!ledger) ledger = std::make_shared<LitLedger>();
  return ledger;
}

}  // namespace granary
