// Is a picture file whole? Asked before any decoder sees it: decoders differ in how much of a damaged file they hand
// out as a picture.
#pragma once

#include <filesystem>
#include <string_view>

namespace granary {

enum class ImageFormat { kPng, kTiff, kPgm };

/// The format by its first bytes, after the container was followed to its end: PNG chunk by chunk with checksums,
/// TIFF's first picture strip by strip, PGM by its size.
/// @throws FileError when it is none of the three, truncated or damaged
[[nodiscard]] ImageFormat CheckContainer(const std::filesystem::path& file, std::string_view bytes);

/// The header of a binary PGM (P5).
struct PgmHeader {
  int width = 0, height = 0;
  int maximum = 0;            ///< 1…65535; above 255 a pixel is two bytes, high byte first
  std::size_t pixels_at = 0;  ///< offset of the first pixel
};
/// @throws FileError when it is no PGM or its pixels are not all there
[[nodiscard]] PgmHeader ParsePgm(const std::filesystem::path& file, std::string_view bytes);

}  // namespace granary
