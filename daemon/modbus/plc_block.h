// What is written into the PLC's holding registers, and where.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "daemon/modbus/options.h"
#include "daemon/modbus/registers.h"
#include "daemon/options.h"

namespace granary {

/// One register of the map at its place in the block.
struct PlcField {
  const RegisterRow* row;
  int offset;  ///< registers from the beginning of the block
};

/// One FC16 request: part of a block.
struct PlcWrite {
  int offset, words;
  bool operator==(const PlcWrite&) const = default;
};

/// The block of one bin.
struct PlcBlock {
  std::vector<PlcField> fields;
  int words = 0;
  std::vector<PlcWrite> writes;  ///< in the order of sending; no value is split between two
};

/// The fields by name one after the other, or the summary, registers 0–64 at their own places, when there are none. A
/// block longer than one write takes is split; the part that holds sequence_check goes last, so that a PLC that finds
/// `sequence` (in an earlier part) and `sequence_check` equal has one measurement.
/// @throws std::invalid_argument for a name that no field can have (see PlcFaults)
[[nodiscard]] PlcBlock LayOutPlcBlock(const std::vector<std::string>& fields);

/// The words of a block in `order`, as the snapshot's invalid policy has it; reserved ones are 0.
[[nodiscard]] std::vector<std::uint16_t> EncodePlcBlock(const PlcBlock& block, const RegisterSource& source,
                                                        ByteOrder order);

/// "volume" for the words that `offset` lies in, "reserved" where no field is.
[[nodiscard]] std::string NameInPlcBlock(const PlcBlock& block, int offset);

}  // namespace granary
