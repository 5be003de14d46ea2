// A figure may be old, held, simulated or suspect; every bit here is a function of the snapshot alone, so that two
// servers can never disagree about one bin.
#include "daemon/modbus/status.h"

#include <cmath>
#include <initializer_list>
#include <utility>

#include "pipeline/types/reason.h"

namespace granary {
namespace {

bool LastFailed(const BinSnapshot& snapshot) { return snapshot.last && !snapshot.last->valid; }

FaultKind LastFault(const BinSnapshot& snapshot) {
  return LastFailed(snapshot) ? InfoOf(snapshot.last->reason).kind : FaultKind::kNone;
}

bool Simulated(const BinSnapshot& snapshot) {
  return snapshot.injected || (snapshot.good && snapshot.good->simulated) ||
         (snapshot.last && snapshot.last->simulated);
}

/// +1 filling, −1 emptying, 0 neither or unknown. A change within the uncertainty of a difference of two figures
/// (√2 · u95) is no movement of grain.
int Movement(const BinSnapshot& snapshot) {
  if (!IsCurrent(snapshot) || !snapshot.change_m3 || !snapshot.good->volume_u95_m3) return 0;
  if (std::abs(*snapshot.change_m3) <= std::sqrt(2.0) * *snapshot.good->volume_u95_m3) return 0;
  return *snapshot.change_m3 > 0 ? 1 : -1;
}

template <typename Word>
Word BitsOf(std::initializer_list<std::pair<int, bool>> bits) {
  Word word = 0;
  for (const auto& [bit, on] : bits) word = static_cast<Word>(word | (static_cast<Word>(on) << bit));
  return word;
}

}  // namespace

const std::array<BitInfo, 16>& StatusBitTable() {
  static constexpr std::array<BitInfo, 16> kTable{{
      {0, "valid", "The figures were measured by the last cycle and are not stale."},
      {1, "held", "The figures are the last good ones; the last cycle failed or none has run since the start."},
      {2, "measuring", "A cycle is running."},
      {3, "stale", "The figures are older than they may be."},
      {4, "simulated", "The figures come from simulated frames, or were injected for a test."},
      {5, "maintenance", "Measuring is inhibited."},
      {6, "no_measurement_yet", "There is no figure at all; floats are NaN."},
      {7, "reduced_accuracy", "Measured under a handicap; see the uncertainty."},
      {8, "abnormal", "The published error rate is beyond the alarm limit (also while held)."},
      {9, "abnormal_latched", "The error rate was beyond the limit and nobody has acknowledged it."},
      {10, "filling", "The volume grew by more than its uncertainty."},
      {11, "emptying", "The volume shrank by more than its uncertainty."},
      {12, "camera_fault", "The last cycle failed at a camera."},
      {13, "projector_fault", "The last cycle failed at the projector or its trigger."},
      {14, "preparation_fault", "The last cycle failed for want of a usable calibration, pose or reference."},
      {15, "book_data_missing", "The published figure has no book quantity or no density, hence no error rate."},
  }};
  return kTable;
}

const std::array<BitInfo, 5>& ValidityBitTable() {
  static constexpr std::array<BitInfo, 5> kTable{{
      {0, "volume", "The volume is current."},
      {1, "level", "The levels are current."},
      {2, "mass", "The quantity is current."},
      {3, "error_rate", "The error rate is current."},
      {4, "temperature", "The rig temperature is current."},
  }};
  return kTable;
}

const std::array<BitInfo, 1>& AlarmBitTable() {
  static constexpr std::array<BitInfo, 1> kTable{{
      {0, "abnormal", "The error rate is beyond the alarm limit."},
  }};
  return kTable;
}

const std::array<NamurInfo, 5>& NamurTable() {
  static constexpr std::array<NamurInfo, 5> kTable{{
      {NamurClass::kOk, "ok", "Measured as specified."},
      {NamurClass::kMaintenance, "maintenance_required", "Still right, but someone should look soon."},
      {NamurClass::kOutOfSpecification, "out_of_specification",
       "Held after a poor picture, held since the start, stale, or of reduced accuracy."},
      {NamurClass::kFunctionCheck, "function_check", "Inhibited, simulated, or not measured yet."},
      {NamurClass::kFailure, "failure",
       "A camera, the projector, the preparation or the program failed, or there is no figure to hold."},
  }};
  return kTable;
}

bool IsCurrent(const BinSnapshot& snapshot) {
  return snapshot.good && snapshot.last && snapshot.last->valid && !snapshot.held && !snapshot.stale;
}

std::uint16_t StatusWord(const BinSnapshot& snapshot) {
  const auto& good = snapshot.good;
  const FaultKind fault = LastFault(snapshot);
  const int movement = Movement(snapshot);
  return BitsOf<std::uint16_t>({
      {0, IsCurrent(snapshot)},
      {1, good && (snapshot.held || LastFailed(snapshot) || !snapshot.last)},
      {2, snapshot.measuring},
      {3, good && snapshot.stale},
      {4, Simulated(snapshot)},
      {5, snapshot.maintenance},
      {6, !good},
      {7, good && good->reduced_accuracy},
      {8, good && good->abnormal.value_or(false)},
      {9, snapshot.abnormal_latched},
      {10, movement > 0},
      {11, movement < 0},
      {12, fault == FaultKind::kCamera},
      {13, fault == FaultKind::kProjector},
      {14, fault == FaultKind::kPreparation},
      {15, good && (!good->book_mass_kg || !good->density_kg_m3)},
  });
}

NamurClass NamurClassOf(const BinSnapshot& snapshot) {
  switch (LastFault(snapshot)) {
    case FaultKind::kCamera:
    case FaultKind::kProjector:
    case FaultKind::kPreparation:
    case FaultKind::kInternal:
      return NamurClass::kFailure;
    case FaultKind::kPicture:
      if (!snapshot.good) return NamurClass::kFailure;
      break;
    case FaultKind::kNone:
      break;
  }
  if (snapshot.maintenance || !snapshot.good || Simulated(snapshot)) return NamurClass::kFunctionCheck;
  if (!IsCurrent(snapshot) || snapshot.good->reduced_accuracy) return NamurClass::kOutOfSpecification;
  return NamurClass::kOk;
}

std::uint16_t ValidityBits(const BinSnapshot& snapshot) {
  if (!IsCurrent(snapshot)) return 0;
  const Measurement& good = *snapshot.good;
  return BitsOf<std::uint16_t>({
      {0, good.volume_m3.has_value()},
      {1, good.level_mean_m.has_value()},
      {2, good.mass_kg.has_value()},
      {3, good.error_rate_percent.has_value()},
      {4, good.temperature_c.has_value()},
  });
}

std::uint32_t ActiveAlarms(const BinSnapshot& snapshot) {
  return BitsOf<std::uint32_t>({{0, snapshot.good && snapshot.good->abnormal.value_or(false)}});
}

std::uint32_t LatchedAlarms(const BinSnapshot& snapshot) {
  return BitsOf<std::uint32_t>({{0, snapshot.abnormal_latched}});
}

std::uint64_t CoilBits(const BinSnapshot& snapshot) {
  const bool measures = snapshot.command == CommandState{BinCommand::kMeasure, CommandResult::kBusy};
  return StatusWord(snapshot) | (std::uint64_t{ActiveAlarms(snapshot)} << 16) |
         BitsOf<std::uint64_t>({{kMeasureCoil, measures}, {kInhibitCoil, snapshot.maintenance}});
}

}  // namespace granary
