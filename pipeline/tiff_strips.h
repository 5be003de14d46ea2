// How the bytes of a TIFF's strip are packed.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

namespace granary {

/// Each unpacks one strip and fills `to` to its last byte. False: `packed` is damaged, ends too early, or (Deflate)
/// holds more than that; `to` is then of no use.
[[nodiscard]] bool UnpackLzw(std::string_view packed, std::span<std::uint8_t> to);      ///< TIFF 6.0, section 13
[[nodiscard]] bool UnpackDeflate(std::string_view packed, std::span<std::uint8_t> to);  ///< zlib, with its checksum
[[nodiscard]] bool UnpackBytes(std::string_view packed, std::span<std::uint8_t> to);    ///< PackBits, section 9

}  // namespace granary
