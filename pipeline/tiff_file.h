// TIFF in memory: one-channel grey, as cameras and their tools write it. Read only: nothing of ours writes TIFF.
// An own reader, as Debian's libtiff brings GPL code (jbig) along. Source: TIFF 6.0 (Adobe, 1992); BigTIFF likewise.
#pragma once

#include <filesystem>
#include <string_view>

#include <opencv2/core/mat.hpp>

namespace granary {

/// The first picture of the file. Read are: little and big endian, 8 and 16 bits unsigned, MinIsBlack, strips,
/// compression none, LZW, Deflate or PackBits, predictor 1 or 2.
/// @param bytes the whole file, beginning with II or MM
/// @return CV_8UC1 or CV_16UC1
/// @throws FileError when it is truncated or damaged, or is stored in another way, saying which are read
[[nodiscard]] cv::Mat DecodeTiff(const std::filesystem::path& file, std::string_view bytes);

}  // namespace granary
