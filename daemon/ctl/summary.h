// A measurement as a person reads it.
#pragma once

#include <string>

#include "pipeline/types/bin.h"
#include "pipeline/types/measurement.h"

namespace granary {

/// Several lines, the last without its newline. What is unknown is left out or said to be unknown.
[[nodiscard]] std::string Summary(const Measurement& measurement, const Bin& bin);

/// What the volume's uncertainty is made of: one line a term with twice its standard uncertainty, in m³, in % of the
/// volume and in percentage points of the error rate. @param measurement with a budget
[[nodiscard]] std::string BudgetTable(const Measurement& measurement);

}  // namespace granary
