// Coarse to fine: a search on pictures of half the size says where the full one needs to look.
#pragma once

#include <optional>

#include "pipeline/options.h"
#include "pipeline/stereo/aggregate.h"
#include "pipeline/stereo/search.h"

namespace granary {

/// A window of disparities for every tile of the left picture, wide enough for what the half-size pictures show in the
/// tile and around it; tiles in which they show nothing take their neighbours'.
/// @return nothing when the windows would save less than a third of the search, or the half-size pictures match nowhere
[[nodiscard]] std::optional<DisparityTiles> ProposeTiles(const GreyPair& pair, DisparityRange range,
                                                         const StereoOptions& options);

}  // namespace granary
