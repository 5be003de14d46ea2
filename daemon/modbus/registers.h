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
#include "daemon/options.h"
#include "daemon/snapshot.h"
#include "pipeline/types/frame.h"

namespace granary {

inline constexpr int kRegisterCount = 4000;      ///< addresses 0…3999 can be read; reserved ones read 0
inline constexpr int kFormattedRegisters = 900;  ///< registers 0…899 are written out as register 900 says
inline constexpr int kMirroredRegisters = 126;   ///< registers 0…125 are there again in each byte order
inline constexpr std::uint16_t kMapVersion = 1;

/// Integers that have no unknown of their own say it with all bits set; a scaled one with its least number.
inline constexpr std::uint16_t kUnknownU16 = 0xFFFF;
inline constexpr std::uint32_t kUnknownU32 = 0xFFFFFFFF;
inline constexpr std::int32_t kUnknownI32 = INT32_MIN;

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

/// A mirror shows registers 0…125 in a byte order of its own, whatever register 900 says.
enum class RegisterType : std::uint8_t { kU16, kU32, kI32, kF32, kAscii, kMirror };
/// "u16", "u32", "i32", "f32", "ascii", "mirror".
[[nodiscard]] std::string_view NameOf(RegisterType type);

enum class RegisterAccess : std::uint8_t { kRead, kReadWrite };

/// An integer (of a mirror: its ByteOrder), a float or a scaled integer (NaN unknown), or text.
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
  RegisterAccess access = RegisterAccess::kRead;
  bool figure = false;  ///< of the published measurement, so that InvalidPolicy applies
};

/// The map, in ascending order of the address.
[[nodiscard]] std::span<const RegisterRow> RegisterTable();
/// The row of that name, or nullptr.
[[nodiscard]] const RegisterRow* FindRegister(std::string_view name);

/// Writes one row out: 32-bit values in `format`'s byte order (whatever the address; a mirror keeps its own), text high
/// byte first and padded with NUL, a figure that is not current as `format` wants it.
/// @param words row.words of them @throws std::invalid_argument for another number of words
void EncodeRow(const RegisterRow& row, const RegisterSource& source, const RegisterFormat& format,
               std::span<std::uint16_t> words);

/// The words of all addresses, each as the number that goes over the wire high byte first.
using RegisterImage = std::array<std::uint16_t, kRegisterCount>;

/// Encodes one bin at one moment: registers 0…899 in the snapshot's format, those above with the high word first.
[[nodiscard]] RegisterImage EncodeRegisters(const RegisterSource& source);
/// The same for rows that begin at `first` up to, but not at, `last`; the rest of the image stays as it is.
void EncodeRows(int first, int last, const RegisterSource& source, RegisterImage& image);

/// At most `bytes` of a UTF-8 text, cut between characters, so that a name in any language stays readable.
[[nodiscard]] std::string_view CutText(std::string_view text, std::size_t bytes);

}  // namespace granary
