// The snapshot is the one visible state; every change goes through Update. What was never measured stays empty, what is
// old stays with its own time and is called held.
#include "daemon/bin_monitor.h"

#include <spdlog/spdlog.h>
#include <algorithm>
#include <limits>
#include <utility>

#include "daemon/bin_lines.h"
#include "daemon/memory.h"
#include "daemon/record_json.h"
#include "daemon/schedule.h"

namespace granary {
namespace {

constexpr std::uint32_t kUnknownRestarts = std::numeric_limits<std::uint32_t>::max();

/// True after a cycle that failed at a device, which may work again a moment later.
bool IsDeviceTrouble(const BinSnapshot& snapshot) {
  if (!snapshot.last || snapshot.last->valid) return false;
  const FaultKind kind = InfoOf(snapshot.last->reason).kind;
  return kind == FaultKind::kCamera || kind == FaultKind::kProjector;
}

/// Pause before the next trial after so many.
std::chrono::seconds TrialDelay(int trials) {
  return std::chrono::seconds{std::min(30, 5 * (1 << std::min(trials, 3)))};
}

/// Change of volume since `before`, and how fast it went. Without two volumes in this order both are unknown.
void SetChange(const std::optional<Measurement>& before, const Measurement& now, BinSnapshot& snapshot) {
  snapshot.change_m3.reset();
  snapshot.rate_m3_h.reset();
  if (!before || !before->volume_m3 || !now.volume_m3 || now.utc <= before->utc) return;
  using Hours = std::chrono::duration<double, std::ratio<3600>>;
  snapshot.change_m3 = *now.volume_m3 - *before->volume_m3;
  snapshot.rate_m3_h = *snapshot.change_m3 / Hours(now.utc - before->utc).count();
}

}  // namespace

BinMonitor::BinMonitor(BinSetup setup, Records& records, std::vector<Publisher*> publishers, Clock& clock,
                       RigOpener open)
    : setup_(std::move(setup)), records_(records), publishers_(std::move(publishers)), clock_(clock) {
  for (const auto& plan : setup_.rigs) slots_.emplace_back(plan, open, clock_);
  snapshot_.bin = setup_.bin;
  snapshot_.configuration_hash = setup_.configuration_hash;
  snapshot_.book = {.in_force = setup_.inventory, .writable = setup_.book_source == BookSource::kRegisters};
  snapshot_.format = setup_.format;
}

void BinMonitor::Restore(const std::optional<BinSnapshot>& carried) {
  std::optional<Measurement> good = carried ? carried->good : std::nullopt;
  if (!good) good = records_.LastGood(setup_.bin.id);
  // A figure of the simulator must never be held for real grain, nor the other way round.
  if (good && good->simulated != setup_.simulated) good.reset();

  CycleSteps steps;
  steps.capture = [this] { return Capture(); };
  steps.measure = [this](const std::vector<Shot>& shots) { return Measure(shots); };
  steps.publish = [this](const Measurement& measurement) { Finish(measurement); };
  steps.entered = [this](CycleState state) {
    progress_.Promise(clock_.Steady(),
                      DeadlineOf(state, setup_.cycle, slots_.size() * static_cast<std::size_t>(setup_.shots)));
    spdlog::debug("{}: {}", NameOf(setup_.bin), NameOf(state));
  };
  cycle_.emplace(setup_.cycle, std::move(steps), clock_, good);

  if (good)
    spdlog::info("{}: held until measured: {} of {}", NameOf(setup_.bin), VolumeText(*good), UtcText(good->utc));
  Update([&](BinSnapshot& s) {
    if (carried) {
      s = *carried;
      s.bin = setup_.bin;
      s.configuration_hash = setup_.configuration_hash;
      s.measuring = false;
      carried_devices_ = carried->devices;
      carried_reopened_ = carried->reopened;
    }
    s.good = good;
    s.held = good.has_value();
    RestoreState(carried, s);
  });
}

void BinMonitor::Prepare() {
  if (!setup_.prepare) return;
  setup_.prepare(setup_);
  const std::scoped_lock lock(mutex_);
  snapshot_.configuration_hash = setup_.configuration_hash;
  // Of a monitor that is not restored yet nobody has heard.
  if (taking_) PublishSnapshot();
}

void BinMonitor::RestoreState(const std::optional<BinSnapshot>& carried, BinSnapshot& s) {
  const std::optional<BinState> known = records_.State(setup_.bin.id);
  const BinState state = known.value_or(BinState{});
  s.restarts = records_.Restarts().value_or(kUnknownRestarts);
  s.abnormal_latched =
      carried ? carried->abnormal_latched : state.abnormal_latched.value_or(s.good && s.good->abnormal.value_or(false));
  s.format = state.format.value_or(setup_.format);

  s.book = {.in_force = setup_.inventory, .writable = setup_.book_source == BookSource::kRegisters};
  if (state.book && s.book.writable) {
    client_book_ = state.book->data;
    s.book.in_force = WithBook(setup_.inventory, state.book->data);
    if (BookToJson(s.book.in_force) != BookToJson(setup_.inventory)) {
      spdlog::warn("{}", BookLine(setup_.bin, *state.book, setup_.inventory));
    }
  }

  // Nobody may be lit whom an inhibition protects: what cannot be read counts as one.
  s.maintenance = carried ? carried->maintenance : state.inhibition.has_value() || !known;
  inhibit_stored_ = state.inhibition.has_value();
  if (s.maintenance) {
    s.next_at.reset();
    spdlog::warn("{}", InhibitionLine(setup_.bin, state.inhibition));
  }
  // The monitor before has promised a measurement.
  measure_asked_ = s.command == CommandState{BinCommand::kMeasure, CommandResult::kBusy};
  ledger_.emplace(records_, setup_.bin.id, state);
  taking_ = true;
}

void BinMonitor::Open() {
  for (auto& slot : slots_) {
    progress_.Promise(clock_.Steady(), DeadlineOf(CycleState::kCapturing, setup_.cycle, 1));
    try {
      slot.Open();
    } catch (const DeviceError& error) {
      spdlog::error("{}: rig {} cannot be opened: {}", NameOf(setup_.bin), slot.options().name, error.what());
    }
  }
}

bool BinMonitor::RunCycle(const std::stop_token& stop) {
  trials_ = 0;
  return Run(stop, CycleKind::kScheduled);
}

bool BinMonitor::TryAgain(const std::stop_token& stop) {
  if (!IsDeviceTrouble(Snapshot()) || clock_.Steady() < try_at_) return false;
  ++trials_;
  return Run(stop, CycleKind::kTrial);
}

bool BinMonitor::Run(const std::stop_token& stop, CycleKind kind) {
  std::stop_source halt;
  const std::stop_callback end_too(stop, [&halt] { halt.request_stop(); });
  bool begun = false;
  Update([&](BinSnapshot& s) {
    if (s.maintenance) return;
    begun = s.measuring = true;
    cycle_halt_ = halt;
  });
  if (!begun) return false;
  cycle_stop_ = halt.get_token();
  const bool published = cycle_.value().Run(cycle_stop_, kind).has_value();
  try_at_ = clock_.Steady() + TrialDelay(trials_);
  if (!published) {
    Update([this](BinSnapshot& s) {
      s.measuring = false;
      CountDevices(s);
    });
  }
  return published;
}

std::vector<Shot> BinMonitor::Capture() {
  std::vector<Shot> shots;
  for (int k = 0; k < setup_.shots; ++k) {
    Shot& shot = shots.emplace_back();
    // One rig after the other: two projectors at once would each disturb the other's speckle.
    for (auto& slot : slots_) {
      if (cycle_stop_.stop_requested()) {
        throw DeviceError(Reason::kNotMeasured, NameOf(setup_.bin), "capture", "the cycle was ended");
      }
      shot.push_back(slot.Capture());
    }
  }
  return shots;
}

Measurement BinMonitor::Measure(const std::vector<Shot>& shots) {
  return setup_.measure(shots, Snapshot().book.in_force);
}

void BinMonitor::CountDevices(BinSnapshot& snapshot) const {
  snapshot.devices = carried_devices_;
  snapshot.reopened = carried_reopened_;
  for (const auto& slot : slots_) {
    snapshot.devices += slot.counters();
    snapshot.reopened += slot.reopened();
  }
}

void BinMonitor::Finish(const Measurement& measurement) {
  Measurement record = measurement;
  record.bin = setup_.bin.id;
  record.peak_rss_mib = PeakRss_mib();
  records_.Append(record);  // gives it its sequence number
  Update([&](BinSnapshot& s) {
    if (std::exchange(answers_measure_, false)) s.command.result = CommandResult::kDone;
    ++s.cycles;
    s.measuring = false;
    CountDevices(s);
    s.last = record;
    s.held = !record.valid && s.good.has_value();
    if (record.valid) {
      SetChange(s.good, record, s);
      if (record.abnormal.value_or(false) && !std::exchange(s.abnormal_latched, true)) {
        LedgerEntry entry;
        entry.change = [](BinState& state) { state.abnormal_latched = true; };
        ledger_->Post(std::move(entry));
      }
      s.good = record;
    } else {
      ++s.failures;
      s.last_failure = record.reason;
    }
  });
  Log(Snapshot());
}

void BinMonitor::Log(const BinSnapshot& snapshot) {
  const Measurement& last = *snapshot.last;
  if (last.valid) {
    if (fault_log_.Clear()) spdlog::warn("{}: measures again", NameOf(setup_.bin));
    spdlog::info("{}", CycleLine(setup_.bin, last));
    return;
  }
  // Words of devices may count or stamp; the reason is what repeats.
  const bool news = fault_log_.Raise(InfoOf(last.reason).name, clock_.Steady());
  spdlog::log(news ? spdlog::level::err : spdlog::level::debug, "{}", FailureLine(snapshot));
}

void BinMonitor::Idle(std::optional<UtcTime> next_at) {
  progress_.Promise(clock_.Steady(), DeadlineOf(CycleState::kIdle, setup_.cycle, 1));
  for (auto& slot : slots_) {
    if (!slot.ReopenIfDue()) continue;
    spdlog::info("{}: rig {} is open again", NameOf(setup_.bin), slot.options().name);
    try_at_ = {};
  }
  if (Snapshot().next_at == next_at) return;
  Update([&](BinSnapshot& s) {
    if (!s.maintenance) s.next_at = next_at;
  });
}

bool BinMonitor::RestIfInhibited() {
  if (!Snapshot().maintenance) {
    if (!resting_) return false;
    Update([this](BinSnapshot&) { resting_ = false; });
    Open();
    return false;
  }
  progress_.Promise(clock_.Steady(), DeadlineOf(CycleState::kIdle, setup_.cycle, 1));
  if (resting_) return true;
  for (auto& slot : slots_) slot.Close();
  Update([this](BinSnapshot& s) {
    resting_ = true;
    s.next_at.reset();
    s.held = s.good.has_value();
    CountDevices(s);
    SettleInhibit(s);
  });
  spdlog::info("{}: rests, its devices are closed", NameOf(setup_.bin));
  return true;
}

bool BinMonitor::TakeMeasure() {
  const std::scoped_lock lock(mutex_);
  if (std::exchange(measure_asked_, false)) answers_measure_ = true;
  return answers_measure_;
}

std::stop_source BinMonitor::NextWake() {
  const std::scoped_lock lock(mutex_);
  wake_ = std::stop_source();
  return wake_;
}

void BinMonitor::Close() noexcept {
  for (auto& slot : slots_) slot.Close();
  progress_.Rest();
  Update([this](BinSnapshot&) {
    if (injected_) DropInjection("the daemon");
    taking_ = false;
  });
  // A successor reads what clients wrote here.
  if (ledger_) ledger_->Drain();
}

bool BinMonitor::Supervise() {
  const bool progress = progress_.Kept(clock_.Steady());
  Update([&](BinSnapshot& s) {
    if (progress) ++s.heartbeat;
    if (injected_ && clock_.Steady() >= injected_until_) DropInjection("the daemon");
  });
  return progress;
}

void BinMonitor::Interrupt() noexcept {
  for (auto& slot : slots_) slot.Interrupt();
}

BinSnapshot BinMonitor::Snapshot() const {
  const std::scoped_lock lock(mutex_);
  return snapshot_;
}

BinSnapshot BinMonitor::Published() const {
  const std::scoped_lock lock(mutex_);
  return ToPublish();
}

void BinMonitor::Update(const std::function<void(BinSnapshot&)>& change) {
  const std::scoped_lock lock(mutex_);
  change(snapshot_);
  PublishSnapshot();
}

void BinMonitor::PublishSnapshot() {
  snapshot_.stale = snapshot_.good && clock_.Now() - snapshot_.good->utc > StaleAfter(setup_.schedule, setup_.cycle);
  const BinSnapshot published = ToPublish();
  for (auto* publisher : publishers_) publisher->Publish(published);
}

BinSnapshot BinMonitor::ToPublish() const { return injected_ ? WithInjected(snapshot_, *injected_) : snapshot_; }

}  // namespace granary
