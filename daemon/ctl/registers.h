// granaryctl registers: prints the Modbus register map.
#pragma once

#include <iosfwd>
#include <string_view>

namespace granary {

/// Prints the map as "text", "csv", "json" or "markdown".
/// @return 0, or 2 for another format, named on `err`
int RunRegisters(std::string_view format, std::ostream& out, std::ostream& err);

}  // namespace granary
