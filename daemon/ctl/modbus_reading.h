// What a Modbus client reads, with names and units.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "daemon/ctl/modbus_client.h"
#include "daemon/modbus/registers.h"
#include "daemon/options.h"

namespace granary {

/// A part of the map that is read and shown together; what no row claims at its end is not read.
struct RegisterBlock {
  std::string_view name;
  int first, last;  ///< addresses, both inside
};
/// "summary", "5708", "diagnostics", "identity", "settings", "integers": all of the map but its mirrors.
[[nodiscard]] std::span<const RegisterBlock> RegisterBlocks();
/// One block by its name, or all of them for "all"; empty for another name.
[[nodiscard]] std::vector<RegisterBlock> BlocksNamed(std::string_view name);

/// A value as a client may use it: nothing where the server says that it is not known.
using ReadValue = std::variant<std::monostate, std::int64_t, double, std::string>;

/// Takes the value of `row` out of its words. A float is the shortest decimal that reads back to the same.
/// @param words as they came over the wire, row.words of them
/// @param format that the words were written out in
[[nodiscard]] ReadValue Decode(const RegisterRow& row, std::span<const std::uint16_t> words,
                               const RegisterFormat& format);

/// Some blocks of one unit, read one after the other.
struct Reading {
  struct Row {
    const RegisterRow* row;
    ReadValue value;
  };
  RegisterFormat format;
  std::vector<Row> rows;  ///< in the order of the blocks

  /// The value of the register of this name; nothing when it is not known. @throws std::out_of_range when it was not
  /// read
  [[nodiscard]] const ReadValue& Of(std::string_view name) const;
  /// The same for an integer that is always known, e.g. "status". @throws std::out_of_range, std::bad_variant_access
  [[nodiscard]] std::int64_t IntegerOf(std::string_view name) const { return std::get<std::int64_t>(Of(name)); }
};

/// Reads the byte order in force, then the blocks, each of 125 registers or less in one request.
/// @throws ModbusClientError, also when the byte order changes again and again while it reads
[[nodiscard]] Reading ReadBlocks(ModbusClient& client, std::span<const RegisterBlock> blocks);

/// The names of the bits of register 0 that are on.
[[nodiscard]] std::vector<std::string> StatusNames(std::int64_t status);
/// "19.5", "17", "granaryd", or "-" for what is not known.
[[nodiscard]] std::string TextOf(const ReadValue& value);

}  // namespace granary
