// A full disk must not stop a measurement: figures still go out over Modbus, and the log says what is not being kept.
#include "daemon/records.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <system_error>
#include <utility>

namespace granary {

Records::Records(std::filesystem::path folder, Clock& clock) : folder_(std::move(folder)), clock_(clock) {}

void Records::Append(Measurement& measurement) {
  const std::scoped_lock lock(mutex_);
  std::uint64_t& last = last_sequence_[measurement.bin];
  const bool open = Use([&](Store& store) { last = std::max(last, store.LastSequence(measurement.bin)); });
  measurement.sequence = ++last;
  if (open && Use([&](Store& store) { store.Append(measurement); })) NoteKept();
}

std::optional<Measurement> Records::LastGood(int bin) {
  const std::scoped_lock lock(mutex_);
  std::optional<Measurement> good;
  Read([&](const Store& store) { good = store.LastGood(bin); });
  return good;
}

std::optional<BinState> Records::State(int bin) {
  const std::scoped_lock lock(mutex_);
  std::optional<BinState> state;
  if (Read([&](const Store& store) { state = store.State(bin); })) return state.value_or(BinState{});
  std::error_code unreachable;  // then there is none
  if (std::filesystem::exists(folder_ / "records.sqlite", unreachable)) return std::nullopt;
  return BinState{};
}

bool Records::Keep(int bin, const BinState& state, const std::vector<JournalEntry>& entries) {
  const std::scoped_lock lock(mutex_);
  if (!Use([&](Store& store) { store.Keep(bin, state, entries); })) return false;
  NoteKept();
  return true;
}

std::optional<std::uint32_t> Records::Restarts() {
  const std::scoped_lock lock(mutex_);
  if (!restarts_) Use([&](Store& store) { restarts_ = store.CountStart() - 1; });
  return restarts_;
}

bool Records::Read(const std::function<void(const Store&)>& work) {
  if (Use(work)) return true;
  try {
    work(Store(folder_, Store::Access::kReadFullDisk));
  } catch (const StoreError&) {
    return false;  // Use has told of the trouble
  }
  return true;
}

void Records::NoteKept() {
  // Only what was kept ends the fault: a full disk can still be read.
  if (fault_log_.Clear()) spdlog::warn("records are being kept again in {}", folder_.string());
}

bool Records::Use(const std::function<void(Store&)>& work) {
  try {
    if (!store_) store_ = std::make_unique<Store>(folder_);
    work(*store_);
  } catch (const StoreError& error) {
    store_.reset();
    if (fault_log_.Raise(error.what(), clock_.Steady())) {
      spdlog::error("RECORDS ARE NOT BEING KEPT: {}; measuring goes on", error.what());
    }
    return false;
  }
  return true;
}

}  // namespace granary
