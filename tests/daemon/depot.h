// One bin with one fake rig, whose verdicts are scripted, on a folder that a restart finds again.
#pragma once

#include <deque>
#include <memory>
#include <mutex>
#include <stop_token>
#include <utility>
#include <vector>

#include "daemon/bin_monitor.h"
#include "pipeline/inventory.h"
#include "tests/daemon/fakes.h"
#include "tests/pipeline/temporary_folder.h"

namespace granary {

struct Depot {
  TemporaryFolder folder;
  FakeClock clock;
  std::unique_ptr<Records> records = std::make_unique<Records>(folder.path(), clock);
  FakePublisher publisher;
  std::shared_ptr<FakeBench> bench = std::make_shared<FakeBench>();
  std::stop_source stop;
  BookSource book_source = BookSource::kRegisters;

  /// 2 m² and 1 m high; each measurement finds 1 m³ and compares it with the book data it is given.
  BinSetup Setup() {
    BinSetup setup;
    setup.bin.id = 3;
    setup.bin.name = "bay-3";
    setup.bin.footprint_m = {{0, 0}, {2, 0}, {2, 1}, {0, 1}};
    setup.bin.height_m = 1;
    setup.schedule.every = std::chrono::minutes{30};
    setup.cycle.attempts = 2;
    setup.cycle.retry_delay = std::chrono::seconds{2};
    setup.rigs.emplace_back().options.projector.driver = ProjectorDriver::kSim;
    setup.inventory.book_mass_kg = 800;
    setup.inventory.density_kg_m3 = 800;
    setup.book_source = book_source;
    setup.measure = [this](const std::vector<Shot>&, const Inventory& inventory) {
      if (before_measuring) before_measuring();
      Measurement m = Valid(1.0);
      ApplyInventory(m, inventory);
      return m;
    };
    return setup;
  }
  std::function<void()> before_measuring;  ///< called while a cycle runs

  std::unique_ptr<BinMonitor> Monitor(const std::optional<BinSnapshot>& carried = std::nullopt) {
    auto monitor = std::make_unique<BinMonitor>(Setup(), *records, std::vector<Publisher*>{&publisher}, clock,
                                                FakeOpener(bench, clock));
    monitor->Restore(carried);
    return monitor;
  }
  /// What a restart of the process finds.
  void NewRecords() { records = std::make_unique<Records>(folder.path(), clock); }
  [[nodiscard]] std::vector<JournalEntry> Journal() const {
    return Store(folder.path(), Store::Access::kRead).Journal(100);
  }
};

inline const BookData kBook{.book_mass_kg = 1000, .density_kg_m3 = 750, .correction = 1.02, .loss_kg = 5};

/// For Await: the handshake has come to this.
inline auto Came(BinCommand command, CommandResult result) {
  return [=](const BinSnapshot& s) { return s.command == CommandState{command, result}; };
}
inline auto Committed(CommandResult result) {
  return [=](const BinSnapshot& s) { return s.book.commit == result; };
}

}  // namespace granary
