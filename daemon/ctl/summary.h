// A measurement as a person reads it.
#pragma once

#include <string>

#include "pipeline/types/bin.h"
#include "pipeline/types/measurement.h"

namespace granary {

/// Several lines, the last without its newline. What is unknown is left out or said to be unknown.
[[nodiscard]] std::string Summary(const Measurement& measurement, const Bin& bin);

}  // namespace granary
