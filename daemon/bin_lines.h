// What the log says of a bin: one line each, for a person.
#pragma once

#include <string>

#include "daemon/bin_state.h"
#include "daemon/snapshot.h"
#include "pipeline/types/bin.h"
#include "pipeline/types/measurement.h"

namespace granary {

/// "bin 1 bay-1".
[[nodiscard]] std::string NameOf(const Bin& bin);
/// Volume with its uncertainty, both to the digits that the uncertainty leaves meaningful.
[[nodiscard]] std::string VolumeText(const Measurement& measurement);
/// "bin 1 bay-1: 0.01901 m³ ±0.00006, 15.02 t, error -1.2 % (ok), coverage 97 %, 0.9 s".
[[nodiscard]] std::string CycleLine(const Bin& bin, const Measurement& measurement);
/// The same for a cycle without a figure: the reason, and what is held instead.
[[nodiscard]] std::string FailureLine(const BinSnapshot& snapshot);
/// Whose book data are in force, since when, and what the file says instead.
[[nodiscard]] std::string BookLine(const Bin& bin, const BinState::Book& book, const Inventory& of_file);
/// That nothing is captured, and since when and for whom; without an inhibition: because nobody knows.
[[nodiscard]] std::string InhibitionLine(const Bin& bin, const std::optional<BinState::Inhibition>& inhibition);

}  // namespace granary
