// Pictures of several exposures merged into one.
#pragma once

#include <vector>

#include "pipeline/types/frame.h"

namespace granary {

inline constexpr double kBracketRatio = 4;  ///< each exposure of a bracket is this much shorter than the one before

/// Share of the pixels, 0 … 1, that are full or so nearly full that they may be clipped.
[[nodiscard]] double SaturatedShare(const Frame& frame);

/// One linear picture: every pixel from the longest exposure in which it is not saturated, times the ratio of the
/// exposures. The result is CV_16UC1 with two more bits an exposure, up to 16; all but the pixels is the first's.
/// @param longest_first at least one, equal in size, type and bits; each exposed kBracketRatio shorter than the last
/// @throws std::invalid_argument when they are not alike
[[nodiscard]] Frame MergeBrackets(const std::vector<Frame>& longest_first);

}  // namespace granary
