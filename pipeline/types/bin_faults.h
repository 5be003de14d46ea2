// What can be wrong with a bin's geometry and book data.
#pragma once

#include <string>
#include <vector>

#include "pipeline/types/bin.h"

namespace granary {

/// What is wrong with one polygon: words without a key ("crosses itself …"); empty when it is a simple polygon with at
/// least 3 distinct corners, finite coordinates within ± 500 m and an area.
[[nodiscard]] std::string PolygonFault(const Polygon& polygon);
/// One "key: what, what is allowed" for each fault; empty when all is well. Keys are those of the configuration:
/// "id", "footprint_m", "exclude_m[1]", "height_m".
[[nodiscard]] std::vector<std::string> Faults(const Bin& bin);
/// The same for what lies in the bin.
[[nodiscard]] std::vector<std::string> Faults(const GrainKind& grain);
/// The same for book data. Absent values are no fault.
[[nodiscard]] std::vector<std::string> Faults(const Inventory& inventory);

}  // namespace granary
