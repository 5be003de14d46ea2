// Pictures as cameras send them, turned into grey.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <opencv2/core/mat.hpp>

namespace granary {

/// How the pixels of a picture lie in memory. The names with P are packed least significant bit first (GenICam "p"),
/// kMono10Packed and kMono12Packed the older GigE Vision way (two pixels in three bytes), kMipi10 four pixels in five
/// bytes with the low bits last (V4L2 "Y10P").
enum class PixelLayout : std::uint8_t {
  kMono8,
  kMono10,
  kMono12,
  kMono14,
  kMono16,
  kMono10p,
  kMono12p,
  kMono10Packed,
  kMono12Packed,
  kMipi10,
  kYuyv,
  kJpeg
};

/// Bits of a grey value.
[[nodiscard]] int BitDepthOf(PixelLayout layout);
/// Bytes of a row without padding; 0 for kJpeg, whose size is its own. Every row begins on a byte: a packed picture
/// whose rows share one (odd widths of a few cameras) is not read.
[[nodiscard]] std::size_t RowBytesOf(PixelLayout layout, int width);

/// The GenICam names ("Mono8", "Mono12p", …) and the V4L2 four-character names ("GREY", "Y10", "YUYV", "MJPG", …; a
/// trailing space may be left out). Empty for a format that this program does not read.
[[nodiscard]] std::optional<PixelLayout> LayoutOfGenicam(std::string_view name);
[[nodiscard]] std::optional<PixelLayout> LayoutOfV4l2(std::string_view four_characters);

/// A grey picture with pixels of its own: CV_8UC1 for 8 bits, else CV_16UC1 with the value in the low bits. Of kYuyv
/// and kJpeg the luma as it is, limited (16 to 235) or full range: nothing in the picture tells which. Bytes behind the
/// picture are passed over.
/// @param row_bytes from one row's start to the next's; 0: rows without padding
/// @throws std::invalid_argument when `bytes` are too few, a picture is no JPEG or of another size, or a grey value is
///   beyond its bits
[[nodiscard]] cv::Mat ToGrey(std::span<const std::byte> bytes, PixelLayout layout, cv::Size size,
                             std::size_t row_bytes = 0);

}  // namespace granary
