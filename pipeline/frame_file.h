// Pictures from files (PNG, TIFF, PGM) and to files (PNG, PGM).
#pragma once

#include <filesystem>

#include <opencv2/core/mat.hpp>

#include "pipeline/types/frame.h"

namespace granary {

/// The picture as it is stored: CV_8U or CV_16U, 1 channel, or of a PNG also 3 or 4 (BGR, BGRA).
/// @throws FileError when the file is missing, empty, of another format, truncated, damaged or above 16384 pixels a
///   side, or a TIFF that is not one-channel grey; a partly decoded picture is never returned.
[[nodiscard]] cv::Mat ReadImage(const std::filesystem::path& file);

/// One grey frame. `bit_depth` of a 16-bit file is the smallest of 10, 12, 14, 16 that holds its brightest pixel, as
/// files do not say how many bits the camera gave. `exposure_start` stays at the epoch: files do not say that either.
/// @throws FileError as ReadImage, and for a colour picture.
[[nodiscard]] Frame LoadFrame(const std::filesystem::path& file);

/// Two frames of one size and one depth; the larger inferred `bit_depth` serves both.
/// @throws FileError as LoadFrame, and when the two differ, naming both.
[[nodiscard]] FramePair LoadFramePair(const std::filesystem::path& left, const std::filesystem::path& right);
/// The same with the scene's ambient light, which must match the lit pair in size and depth.
[[nodiscard]] FramePair LoadFramePair(const std::filesystem::path& left, const std::filesystem::path& right,
                                      const std::filesystem::path& ambient_left,
                                      const std::filesystem::path& ambient_right);

/// Writes CV_8U or CV_16U without loss; the extension says the format: .png with 1 or 3 (BGR) channels, .pgm with 1.
/// The file is replaced whole or not at all. @throws FileError
void SaveFrame(const std::filesystem::path& file, const cv::Mat& image);

}  // namespace granary
