// The register map, version 1: one table that the servers encode from and every manual is made from.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <variant>

#include "daemon/modbus/tally.h"
#include "daemon/snapshot.h"
#include "pipeline/types/frame.h"

namespace granary {

inline constexpr int kRegisterCount = 4000;     ///< addresses 0…3999 can be read; reserved ones read 0
inline constexpr int kDiscreteInputCount = 48;  ///< 0–15 status bits, 16–47 active alarm bits
inline constexpr std::uint16_t kMapVersion = 1;

/// Integers that have no unknown of their own say it with all bits set.
inline constexpr std::uint16_t kUnknownU16 = 0xFFFF;
inline constexpr std::uint32_t kUnknownU32 = 0xFFFFFFFF;

/// Who answers; the strings are UTF-8.
struct ModbusIdentity {
  std::string vendor = "Granary project";
  std::string product = "granaryd";
  std::string version;
  std::string site;
  std::uint32_t serial = 0;  ///< serial number in the 5708 block, below 2^24
};

/// Everything that the registers of one unit are made from; borrowed.
struct RegisterSource {
  const BinSnapshot& snapshot;
  UtcTime now;
  const ModbusIdentity& identity;
  ModbusCounters counters;
};

enum class RegisterType : std::uint8_t { kU16, kU32, kF32, kAscii };
/// "u16", "u32", "f32", "ascii".
[[nodiscard]] std::string_view NameOf(RegisterType type);

/// An integer, a float (NaN unknown), or text.
using RegisterValue = std::variant<std::uint32_t, double, std::string>;

/// One row of the map.
struct RegisterRow {
  std::uint16_t address;  ///< 0-based
  RegisterType type;
  std::uint16_t words;  ///< registers taken
  std::string_view name;
  std::string_view unit;  ///< empty where there is none
  std::string_view meaning;
  RegisterValue (*value)(const RegisterSource&);
};

/// The map, in ascending order of the address.
[[nodiscard]] std::span<const RegisterRow> RegisterTable();

/// The words of all addresses, each as the number that goes over the wire high byte first.
using RegisterImage = std::array<std::uint16_t, kRegisterCount>;

/// Encodes one bin at one moment: 32-bit values high word first (ABCD), text high byte first and padded with NUL.
[[nodiscard]] RegisterImage EncodeRegisters(const RegisterSource& source);

/// At most `bytes` of a UTF-8 text, cut between characters, so that a name in any language stays readable.
[[nodiscard]] std::string_view CutText(std::string_view text, std::size_t bytes);

/// Discrete input `address` (0…47), out of registers 0 and 52 of the same image. @throws std::out_of_range
[[nodiscard]] bool DiscreteInput(const RegisterImage& image, int address);

}  // namespace granary
