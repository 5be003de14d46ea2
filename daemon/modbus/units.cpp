// A snapshot is shared and never changed: a reader keeps the one it found, whatever is published meanwhile.
#include "daemon/modbus/units.h"

#include <algorithm>
#include <chrono>
#include <stdexcept>
#include <utility>

namespace granary {

ModbusUnits::ModbusUnits(ModbusIdentity identity, const std::vector<Bin>& bins, BinControl& control, ModbusTally& tally,
                         std::function<UtcTime()> utc_now)
    : identity_(std::move(identity)),
      control_(control),
      tally_(tally),
      utc_now_(utc_now ? std::move(utc_now) : [] { return UtcTime(std::chrono::system_clock::now()); }) {
  if (bins.empty()) throw std::invalid_argument("modbus: no bins to serve");
  for (const auto& bin : bins) {
    auto unmeasured = std::make_shared<BinSnapshot>();
    unmeasured->bin = bin;
    snapshots_.push_back(std::move(unmeasured));
  }
}

ModbusUnits::~ModbusUnits() = default;

void ModbusUnits::Publish(const BinSnapshot& snapshot) {
  auto next = std::make_shared<const BinSnapshot>(snapshot);
  const std::scoped_lock lock(mutex_);
  const auto same = std::find_if(snapshots_.begin(), snapshots_.end(),
                                 [&](const auto& known) { return known->bin.id == snapshot.bin.id; });
  if (same == snapshots_.end()) {
    snapshots_.push_back(std::move(next));
  } else {
    same->swap(next);
  }
}

bool ModbusUnits::Serves(std::uint8_t unit) const {
  const std::scoped_lock lock(mutex_);
  return std::any_of(snapshots_.begin(), snapshots_.end(), [&](const auto& known) { return known->bin.id == unit; });
}

std::shared_ptr<const BinSnapshot> ModbusUnits::Find(std::uint8_t unit) const {
  const std::scoped_lock lock(mutex_);
  if (unit == 0 || unit == 255) return snapshots_.front();
  const auto found =
      std::find_if(snapshots_.begin(), snapshots_.end(), [&](const auto& known) { return known->bin.id == unit; });
  return found == snapshots_.end() ? nullptr : *found;
}

Pdu ModbusUnits::Answer(std::uint8_t unit, std::span<const std::uint8_t> request, const Requester& requester) {
  static_cast<void>(requester);
  const auto snapshot = Find(unit);
  if (!snapshot) return ExceptionPdu(request[0], ModbusException::kNoSuchUnit);
  return AnswerRequest(request, {*snapshot, utc_now_(), identity_, tally_.Read()});
}

}  // namespace granary
