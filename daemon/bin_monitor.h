// Everything the daemon does for one bin, but the waiting: captures, cycles, what is published.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/clock.h"
#include "daemon/control.h"
#include "daemon/cycle.h"
#include "daemon/fault_log.h"
#include "daemon/injection.h"
#include "daemon/ledger.h"
#include "daemon/options.h"
#include "daemon/progress.h"
#include "daemon/publisher.h"
#include "daemon/records.h"
#include "daemon/rig_slot.h"
#include "daemon/snapshot.h"

namespace granary {

/// One bin as the daemon runs it.
struct BinSetup {
  Bin bin;
  ScheduleOptions schedule;
  CycleOptions cycle;
  std::vector<RigPlan> rigs;
  int shots = 1;  ///< a measurement
  /// The pipeline over the shots of one measurement, compared with these book data.
  std::function<Measurement(const std::vector<Shot>&, const Inventory&)> measure;
  /// What is slow, and waits until held figures are served: sets `measure` and `configuration_hash`. Empty: they are
  /// set already.
  std::function<void(BinSetup&)> prepare;
  Inventory inventory;  ///< of the file; in force until a client commits others
  BookSource book_source = BookSource::kRegisters;
  RegisterFormat format;                 ///< until a client writes another
  bool simulated = false;                ///< its frames come from the simulator
  std::uint32_t configuration_hash = 0;  ///< configuration + calibration + reference
};

/// Used by the worker's thread, but for what says otherwise.
class BinMonitor {
 public:
  /// @param publishers borrowed; they outlive the monitor
  BinMonitor(BinSetup setup, Records& records, std::vector<Publisher*> publishers, Clock& clock, RigOpener open);

  /// Publishes what is known before the first cycle: the newest stored figure as held, with its own time, and what
  /// clients wrote before. From then on commands are taken. When the store cannot be read, nobody knows whether the bin
  /// is inhibited, and it rests until it is released.
  /// @param carried the snapshot of the monitor that this one replaces (same bin, new configuration)
  void Restore(const std::optional<BinSnapshot>& carried = std::nullopt);
  /// The setup's own `prepare`, and what it changes published. Before the first cycle. @throws as it does
  void Prepare();
  /// Opens the rigs before the first cycle, so that a line that a crash left high falls, and trouble is told now and
  /// not at the first scheduled time.
  void Open();
  /// One cycle. @return false when `stop` or an inhibition ended it, between two captures
  bool RunCycle(const std::stop_token& stop);
  /// Between cycles: after one that failed at a camera or projector, tries from time to time (first after 5 s, at last
  /// every 30 s, and at once when a rig could be opened again) whether a measurement succeeds, and publishes it then.
  /// @return true when one was published
  bool TryAgain(const std::stop_token& stop);
  /// What there is to do between cycles, every second or so: reopens rigs, keeps the promise of progress.
  void Idle(std::optional<UtcTime> next_at);
  /// While the bin is inhibited: lets go of the devices, so that projectors are off, and keeps the promise of progress.
  /// After it, opens them again. @return whether the bin is inhibited
  bool RestIfInhibited();
  /// True once for a measurement that was asked for; the cycle that follows answers it.
  [[nodiscard]] bool TakeMeasure();
  /// Stop is requested on it as soon as there is something to do; to be fetched before looking for that.
  [[nodiscard]] std::stop_source NextWake();
  /// Lets go of the devices; the end of the worker, and no hang. Nothing is taken from clients any more, and what they
  /// wrote is on disk, as far as the disk takes it.
  void Close() noexcept;

  // BinControl for this bin (daemon/control.h). Any thread; each returns at once.
  [[nodiscard]] bool Ask(BinCommand command, const std::string& who);
  [[nodiscard]] bool CommitBook(const BookData& book, const std::string& who);
  [[nodiscard]] bool SetFormat(const RegisterFormat& format, const std::string& who);
  /// Publishes a made-up figure for `duration` in place of the true one; cycles go on beneath it and are recorded.
  /// Replaces one that is at work. It does not outlive the monitor. Any thread.
  /// @param duration 1 s to a day
  /// @return what is wrong with it; empty when it is published
  [[nodiscard]] std::vector<std::string> Inject(const Injection& injection, std::chrono::seconds duration,
                                                const std::string& who);
  /// Publishes the true state again. Any thread. @return false when nothing is injected
  bool EndInjection(const std::string& who);

  /// Called once a second by the supervising loop: while the worker makes progress the heartbeat goes on.
  /// Ends an injection whose time is over. Any thread. @return false when the worker hangs
  bool Supervise();
  /// Ends a capture that blocks. Any thread.
  void Interrupt() noexcept;
  /// The true state, also during an injection. Any thread.
  [[nodiscard]] BinSnapshot Snapshot() const;
  /// The state as it is published. Any thread.
  [[nodiscard]] BinSnapshot Published() const;
  [[nodiscard]] const BinSetup& setup() const { return setup_; }

 private:
  [[nodiscard]] bool Run(const std::stop_token& stop, CycleKind kind);
  [[nodiscard]] std::vector<Shot> Capture();
  [[nodiscard]] Measurement Measure(const std::vector<Shot>& shots);
  void CountDevices(BinSnapshot& snapshot) const;
  void Finish(const Measurement& measurement);
  void Log(const BinSnapshot& snapshot);
  /// Changes the snapshot and publishes it as one step, so that publishers see the changes in order.
  void Update(const std::function<void(BinSnapshot&)>& change);
  void RestoreState(const std::optional<BinSnapshot>& carried, BinSnapshot& snapshot);
  /// Wakes the worker, and with `end_cycle` ends its cycle between two captures.
  void Wake(bool end_cycle = false);
  /// Starts a command that needs no disk. @return false when the command before is busy
  [[nodiscard]] bool AskAtOnce(BinCommand command, const std::string& who);
  [[nodiscard]] bool AskAcknowledge(const std::string& who);
  [[nodiscard]] bool AskInhibit(const std::string& who);
  [[nodiscard]] bool AskRelease(const std::string& who);
  /// `change` looks at the snapshot and changes it, and fills in what goes to disk (no journal: nothing does); then the
  /// snapshot is published. It refuses by returning false before it has changed anything.
  /// @return false when it refused, or too much waits for the disk, or no commands are taken
  [[nodiscard]] bool Change(const std::function<bool(BinSnapshot&, LedgerEntry&)>& change);
  [[nodiscard]] JournalEntry Journal(const std::string& who, std::string what) const;

  // With mutex_ held.
  void PublishSnapshot();
  [[nodiscard]] BinSnapshot ToPublish() const;
  void DropInjection(const std::string& who);
  /// An inhibition is done when it is stored and the worker rests.
  void SettleInhibit(BinSnapshot& snapshot) const;

  BinSetup setup_;
  Records& records_;
  std::vector<Publisher*> publishers_;
  Clock& clock_;
  std::deque<RigSlot> slots_;  // never moved: they hold mutexes
  std::optional<Cycle> cycle_;
  Progress progress_;
  RigCounters carried_devices_;  // of the monitor before this one
  std::uint64_t carried_reopened_ = 0;
  int trials_ = 0;  // since the last scheduled cycle
  std::chrono::steady_clock::time_point try_at_{};
  std::stop_token cycle_stop_;    // of the cycle that runs
  bool answers_measure_ = false;  // the cycle that runs was asked for
  FaultLog fault_log_;

  mutable std::mutex mutex_;  // guards what follows, and the order of Publish (which returns at once)
  BinSnapshot snapshot_;      // the true one
  bool taking_ = false;       // commands, between Restore and Close
  bool measure_asked_ = false;
  bool resting_ = false;                 // the worker, with its devices closed
  std::optional<bool> inhibit_stored_;   // of the newest inhibition; empty while it is being written
  std::optional<BookData> client_book_;  // in force, and a client's
  std::stop_source cycle_halt_{std::nostopstate}, wake_{std::nostopstate};
  std::optional<Injected> injected_;
  std::chrono::steady_clock::time_point injected_until_{};

  std::optional<Ledger> ledger_;  // last: its thread uses what stands above
};

}  // namespace granary
