// Colours that pictures and cloud files share, so that a person learns them once.
#pragma once

#include <array>
#include <cstdint>

namespace granary {

/// Red, green, blue.
using Rgb = std::array<std::uint8_t, 3>;

inline constexpr Rgb kMeasuredColour{222, 184, 110};  ///< wheat
inline constexpr Rgb kCompletedColour{40, 110, 220};  ///< a blue that no grain has
inline constexpr Rgb kKeptColour{238, 226, 198};      ///< faint wheat: points kept, behind those removed
inline constexpr Rgb kOutsideColour{150, 150, 150};   ///< removed: outside the bin, or on excluded floor
inline constexpr Rgb kWallColour{40, 110, 220};       ///< removed: a wall, or the strip along it
inline constexpr Rgb kAboveColour{200, 30, 160};      ///< removed: above the top of the bin
inline constexpr Rgb kObjectColour{225, 70, 20};      ///< removed: a thing over the grain, or a stray point

}  // namespace granary
