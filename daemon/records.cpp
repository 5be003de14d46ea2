// A full disk must not stop a measurement: figures still go out over Modbus, and the log says what is not being kept.
#include "daemon/records.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

namespace granary {

Records::Records(std::filesystem::path folder, Clock& clock) : folder_(std::move(folder)), clock_(clock) {}

void Records::Append(Measurement& measurement) {
  const std::scoped_lock lock(mutex_);
  std::uint64_t& last = last_sequence_[measurement.bin];
  const bool open = Use([&](Store& store) { last = std::max(last, store.LastSequence(measurement.bin)); });
  measurement.sequence = ++last;
  // Only a record that was kept ends the fault: a full disk can still be read.
  if (open && Use([&](Store& store) { store.Append(measurement); }) && fault_log_.Clear()) {
    spdlog::warn("records are being kept again in {}", folder_.string());
  }
}

std::optional<Measurement> Records::LastGood(int bin) {
  const std::scoped_lock lock(mutex_);
  std::optional<Measurement> good;
  Use([&](Store& store) { good = store.LastGood(bin); });
  return good;
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
