// What every reader of pictures refuses before it reserves memory for pixels.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "pipeline/file_error.h"

namespace granary {

/// Far above any camera of ours; a file that claims more would only fill the memory.
inline constexpr std::uint64_t kLargestPictureSide_px = 16384;

/// @throws FileError when a side is 0 or above kLargestPictureSide_px
inline void CheckPictureSize(const std::filesystem::path& file, std::uint64_t width, std::uint64_t height) {
  if (width >= 1 && height >= 1 && width <= kLargestPictureSide_px && height <= kLargestPictureSide_px) return;
  throw FileError(file, "says it is " + std::to_string(width) + "x" + std::to_string(height) +
                            " pixels; 1 to 16384 a side are allowed");
}

}  // namespace granary
