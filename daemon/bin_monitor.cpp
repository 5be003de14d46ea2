// The snapshot is the one visible state; every change goes through Update. What was never measured stays empty, what is
// old stays with its own time and is called held.
#include "daemon/bin_monitor.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>
#include <algorithm>
#include <cmath>
#include <utility>

#include "daemon/memory.h"
#include "daemon/record_json.h"
#include "daemon/schedule.h"

namespace granary {
namespace {

std::string NameOf(const Bin& bin) {
  return bin.name.empty() ? fmt::format("bin {}", bin.id) : fmt::format("bin {} {}", bin.id, bin.name);
}

/// Volume with its uncertainty, both to the digits that the uncertainty leaves meaningful.
std::string VolumeText(const Measurement& m) {
  if (!m.volume_m3) return "no volume";
  if (!m.volume_u95_m3 || !(*m.volume_u95_m3 > 0)) return fmt::format("{:.5g} m³", *m.volume_m3);
  const int digits = std::max(0, 1 - static_cast<int>(std::floor(std::log10(*m.volume_u95_m3))) - 1);
  return fmt::format("{:.{}f} m³ ±{:.{}f}", *m.volume_m3, digits, *m.volume_u95_m3, digits);
}

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

std::string CycleLine(const Bin& bin, const Measurement& m) {
  std::string line = NameOf(bin) + ": " + VolumeText(m);
  if (m.mass_kg && *m.mass_kg < 1000.0) line += fmt::format(", {:.2f} kg", *m.mass_kg);
  if (m.mass_kg && *m.mass_kg >= 1000.0) line += fmt::format(", {:.2f} t", *m.mass_kg / 1000.0);
  if (m.error_rate_percent) {
    const double tenths = std::round(*m.error_rate_percent * 10) + 0.0;  // never "-0.0"
    line += fmt::format(", error {:+.1f} % ({})", tenths / 10, m.abnormal.value_or(false) ? "abnormal" : "ok");
  }
  if (m.coverage_percent) line += fmt::format(", coverage {:.0f} %", *m.coverage_percent);
  line += fmt::format(", {:.1f} s", m.timings_ms.total / 1000.0);
  if (m.reduced_accuracy) line += ", reduced accuracy: " + m.detail;
  return line;
}

std::string FailureLine(const BinSnapshot& snapshot) {
  if (!snapshot.last) return NameOf(snapshot.bin) + ": not measured yet";
  const ReasonInfo& info = InfoOf(snapshot.last->reason);
  std::string line = fmt::format("{}: no figure ({}): {}", NameOf(snapshot.bin), info.name,
                                 snapshot.last->detail.empty() ? info.meaning : snapshot.last->detail);
  line += snapshot.good ? fmt::format("; held: {} of {}", VolumeText(*snapshot.good), UtcText(snapshot.good->utc))
                        : std::string("; nothing to hold");
  if (!info.remedy.empty()) line += fmt::format(". {}", info.remedy);
  return line;
}

BinMonitor::BinMonitor(BinSetup setup, Records& records, std::vector<Publisher*> publishers, Clock& clock,
                       RigOpener open)
    : setup_(std::move(setup)), records_(records), publishers_(std::move(publishers)), clock_(clock) {
  for (const auto& plan : setup_.rigs) slots_.emplace_back(plan, open, clock_);
  snapshot_.bin = setup_.bin;
  snapshot_.configuration_hash = setup_.configuration_hash;
}

void BinMonitor::Restore(const std::optional<BinSnapshot>& carried) {
  std::optional<Measurement> good = carried ? carried->good : std::nullopt;
  if (!good) good = records_.LastGood(setup_.bin.id);
  // A figure of the simulator must never be held for real grain, nor the other way round.
  if (good && good->simulated != setup_.simulated) good.reset();

  CycleSteps steps;
  steps.capture = [this] { return Capture(); };
  steps.measure = setup_.measure;
  steps.publish = [this](const Measurement& measurement) { Finish(measurement); };
  steps.entered = [this](CycleState state) {
    progress_.Promise(clock_.Steady(),
                      DeadlineOf(state, setup_.cycle, slots_.size() * static_cast<std::size_t>(setup_.shots)));
    spdlog::debug("{}: {}", NameOf(setup_.bin), granary::NameOf(state));
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
    s.abnormal_latched = s.abnormal_latched || (good && good->abnormal.value_or(false));
  });
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
  Update([](BinSnapshot& s) { s.measuring = true; });
  const bool published = cycle_.value().Run(stop, kind).has_value();
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
    for (auto& slot : slots_) shot.push_back(slot.Capture());
  }
  return shots;
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
    ++s.cycles;
    s.measuring = false;
    CountDevices(s);
    s.last = record;
    s.held = !record.valid && s.good.has_value();
    if (record.valid) {
      SetChange(s.good, record, s);
      s.abnormal_latched = s.abnormal_latched || record.abnormal.value_or(false);
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
  if (Snapshot().next_at != next_at) Update([&](BinSnapshot& s) { s.next_at = next_at; });
}

void BinMonitor::Close() noexcept {
  for (auto& slot : slots_) slot.Close();
  progress_.Rest();
}

bool BinMonitor::Supervise() {
  const bool progress = progress_.Kept(clock_.Steady());
  Update([&](BinSnapshot& s) {
    if (progress) ++s.heartbeat;
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

void BinMonitor::Update(const std::function<void(BinSnapshot&)>& change) {
  const std::scoped_lock lock(mutex_);
  change(snapshot_);
  snapshot_.stale = snapshot_.good && clock_.Now() - snapshot_.good->utc > StaleAfter(setup_.schedule, setup_.cycle);
  for (auto* publisher : publishers_) publisher->Publish(snapshot_);
}

}  // namespace granary
