// PNG in memory, through libpng.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include <opencv2/core/mat.hpp>

namespace granary {

/// @param bytes the whole file, beginning with PNG's signature
/// @return the pixels as stored, CV_8U or CV_16U: 1 channel for grey (1, 2 and 4 bits become 8), 3 for colour (BGR; a
///   palette is looked up), 4 when there is an alpha channel (BGRA, grey included). Metadata is skipped.
/// @throws FileError when it is truncated, damaged or too large; a partly decoded picture is never returned
[[nodiscard]] cv::Mat DecodePng(const std::filesystem::path& file, std::string_view bytes);

/// @param file only to name it  @param image CV_8U or CV_16U with 1 or 3 (BGR) channels, not empty
/// @throws FileError with libpng's words
[[nodiscard]] std::string EncodePng(const std::filesystem::path& file, const cv::Mat& image);

}  // namespace granary
