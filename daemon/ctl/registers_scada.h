// The register map as other people's programs take it in.
#pragma once

#include <iosfwd>
#include <string>
#include <string_view>

namespace granary {

/// An [[inputs.modbus]] section of a Telegraf configuration: summary and diagnostics, one request each.
void PrintTelegraf(std::ostream& out, int unit);

/// A Node-RED flow for node-red-contrib-modbus that reads the summary in one request and names its values.
void PrintNodeRed(std::ostream& out, int unit);

/// Tags for Ignition's Modbus driver as the CSV that its Designer imports, in ASCII: which encoding it reads is not
/// documented.
void PrintIgnition(std::ostream& out, int unit);

/// RFC 4180: quoted where it must be.
[[nodiscard]] std::string CsvField(std::string_view text);

}  // namespace granary
