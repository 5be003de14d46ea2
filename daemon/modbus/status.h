// What a snapshot says about itself in bits and classes: the part of the map that tells whether a figure may be used.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "daemon/snapshot.h"

namespace granary {

inline constexpr int kDiscreteInputCount = 48;  ///< 0–15 status bits, 16–47 active alarm bits
inline constexpr int kCoilCount = 51;           ///< the same, then measure now, acknowledge and inhibit
inline constexpr int kMeasureCoil = 48, kAcknowledgeCoil = 49, kInhibitCoil = 50;

/// One bit of a register, as the manual prints it.
struct BitInfo {
  int bit;
  std::string_view name;
  std::string_view meaning;
};

/// Bits of register 0 and discrete inputs 0–15, in ascending order.
[[nodiscard]] const std::array<BitInfo, 16>& StatusBitTable();
/// Bits of register 3, in ascending order.
[[nodiscard]] const std::array<BitInfo, 5>& ValidityBitTable();
/// Bits of registers 52 and 54 and discrete inputs from 16, in ascending order.
[[nodiscard]] const std::array<BitInfo, 1>& AlarmBitTable();

/// Register 1, NAMUR NE 107; the worst that applies.
enum class NamurClass : std::uint16_t {
  kOk = 0,
  kMaintenance = 1,
  kOutOfSpecification = 2,
  kFunctionCheck = 3,
  kFailure = 4
};

struct NamurInfo {
  NamurClass code;
  std::string_view name;
  std::string_view meaning;
};
/// In ascending order of the code.
[[nodiscard]] const std::array<NamurInfo, 5>& NamurTable();

/// True when `good` was measured by the last cycle and is not stale: nothing held, nothing restored.
[[nodiscard]] bool IsCurrent(const BinSnapshot& snapshot);
/// Register 0.
[[nodiscard]] std::uint16_t StatusWord(const BinSnapshot& snapshot);
/// Register 1. Camera, projector, preparation and internal faults are failures, and so is a poor picture when there is
/// no good figure to hold; with one it is out of specification, as a stale or less accurate figure is.
[[nodiscard]] NamurClass NamurClassOf(const BinSnapshot& snapshot);
/// Register 3: a bit is on when its figure exists and is current.
[[nodiscard]] std::uint16_t ValidityBits(const BinSnapshot& snapshot);
/// Register 52.
[[nodiscard]] std::uint32_t ActiveAlarms(const BinSnapshot& snapshot);
/// Register 54: stays on until acknowledged.
[[nodiscard]] std::uint32_t LatchedAlarms(const BinSnapshot& snapshot);
/// Coil n in bit n; the discrete inputs are the first of them. Measure now reads on while that command is busy, inhibit
/// as the maintenance bit, acknowledge always off.
[[nodiscard]] std::uint64_t CoilBits(const BinSnapshot& snapshot);

}  // namespace granary
