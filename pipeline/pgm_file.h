// Binary PGM (P5): one channel of grey. Source: netpbm's pgm(5).
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include <opencv2/core/mat.hpp>

namespace granary {

/// @param bytes the whole file, beginning with P5
/// @return CV_8UC1, or CV_16UC1 when its maximum is above 255; the numbers as stored, not stretched to the maximum
/// @throws FileError when the header is damaged, or more or fewer pixels follow than it says
[[nodiscard]] cv::Mat DecodePgm(const std::filesystem::path& file, std::string_view bytes);

/// @param image CV_8UC1 or CV_16UC1, not empty
[[nodiscard]] std::string EncodePgm(const cv::Mat& image);

}  // namespace granary
