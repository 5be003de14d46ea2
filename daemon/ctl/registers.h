// granaryctl registers: prints the Modbus register map.
#pragma once

#include <iosfwd>
#include <string>
#include <string_view>
#include <vector>

namespace granary {

/// text, csv, json and markdown for people and programs; telegraf, node-red and ignition ready to be imported there.
[[nodiscard]] const std::vector<std::string>& RegisterFormats();

/// Prints the map in one of the formats.
/// @param unit unit id of the bin in the forms that poll it
/// @return 0, or 2 for another format, named on `err`
int RunRegisters(std::string_view format, std::ostream& out, std::ostream& err, int unit = 1);

}  // namespace granary
