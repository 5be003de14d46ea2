// What only the register map can tell of the options.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "daemon/options.h"

namespace granary {

/// What is wrong with the options for so many bins, beyond what Faults(const ModbusPlcOptions&) can tell: unknown
/// fields, blocks that overlap each other or the book data, or that do not fit below register 65536. One "key: what,
/// what is allowed" each; empty when all is well.
[[nodiscard]] std::vector<std::string> PlcFaults(const ModbusPlcOptions& options, std::size_t bins);

}  // namespace granary
