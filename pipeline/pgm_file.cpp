// A text header of three numbers, then the pixels row by row; 16-bit ones high byte first.
#include "pipeline/pgm_file.h"

#include <cctype>
#include <cstddef>
#include <cstdint>
#include <optional>

#include <opencv2/core.hpp>

#include "pipeline/file_error.h"
#include "pipeline/picture_limits.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

constexpr int kLargestNumber = 65535;

std::uint8_t Byte(std::string_view bytes, std::size_t at) { return static_cast<std::uint8_t>(bytes[at]); }

/// The next number of the header; skips white space and comments.
std::optional<int> NextNumber(std::string_view bytes, std::size_t& at) {
  while (at < bytes.size() && (std::isspace(Byte(bytes, at)) != 0 || bytes[at] == '#')) {
    if (bytes[at] == '#') {
      while (at < bytes.size() && bytes[at] != '\n') ++at;
    } else {
      ++at;
    }
  }
  std::optional<int> value;
  while (at < bytes.size() && std::isdigit(Byte(bytes, at)) != 0) {
    value = value.value_or(0) * 10 + (bytes[at++] - '0');
    if (*value > kLargestNumber) return std::nullopt;
  }
  return value;
}

}  // namespace

cv::Mat DecodePgm(const fs::path& file, std::string_view bytes) {
  std::size_t at = 2;
  const auto width = NextNumber(bytes, at);
  const auto height = NextNumber(bytes, at);
  const auto maximum = NextNumber(bytes, at);
  if (!width || !height || !maximum || *width < 1 || *height < 1 || *maximum < 1 || at >= bytes.size()) {
    throw FileError(file, "is a PGM with a damaged header; width, height and maximum of 1 to 65535 are wanted");
  }
  CheckPictureSize(file, *width, *height);
  const std::size_t pixels_at = at + 1;  // one white space ends the header
  const std::size_t wanted = std::size_t(*width) * std::size_t(*height) * (*maximum > 255 ? 2 : 1);
  const std::size_t present = bytes.size() - pixels_at;
  if (present != wanted) {
    throw FileError(file, std::string(present < wanted ? "is a truncated PGM" : "is a damaged PGM") +
                              ": its header says " + std::to_string(wanted) + " bytes of pixels, it has " +
                              std::to_string(present));
  }

  const auto* pixels = reinterpret_cast<const std::uint8_t*>(bytes.data()) + pixels_at;
  if (*maximum <= 255) return cv::Mat(*height, *width, CV_8UC1, const_cast<std::uint8_t*>(pixels)).clone();
  cv::Mat image(*height, *width, CV_16UC1);
  for (auto& pixel : cv::Mat_<std::uint16_t>(image)) {
    pixel = static_cast<std::uint16_t>(pixels[0] << 8 | pixels[1]);
    pixels += 2;
  }
  return image;
}

std::string EncodePgm(const cv::Mat& image) {
  const bool wide = image.depth() == CV_16U;
  std::string bytes =
      "P5\n" + std::to_string(image.cols) + " " + std::to_string(image.rows) + (wide ? "\n65535\n" : "\n255\n");
  bytes.reserve(bytes.size() + image.total() * image.elemSize());
  for (int v = 0; v < image.rows; ++v) {
    if (!wide) {
      bytes.append(image.ptr<char>(v), static_cast<std::size_t>(image.cols));
      continue;
    }
    const auto* row = image.ptr<std::uint16_t>(v);
    for (int u = 0; u < image.cols; ++u) {
      bytes += static_cast<char>(row[u] >> 8);
      bytes += static_cast<char>(row[u] & 0xFF);
    }
  }
  return bytes;
}

}  // namespace granary
