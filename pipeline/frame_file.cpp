// OpenCV decodes from memory, after the container was found whole; PGM is decoded here, since OpenCV's reading of
// maxima other than 255 and 65535 differs from version to version.
#include "pipeline/frame_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "pipeline/file_bytes.h"
#include "pipeline/file_error.h"
#include "pipeline/image_container.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

cv::Mat DecodePgm(const fs::path& file, std::string_view bytes) {
  const PgmHeader header = ParsePgm(file, bytes);
  const auto* pixels = reinterpret_cast<const std::uint8_t*>(bytes.data()) + header.pixels_at;
  if (header.maximum <= 255) {
    return cv::Mat(header.height, header.width, CV_8UC1, const_cast<std::uint8_t*>(pixels)).clone();
  }
  cv::Mat image(header.height, header.width, CV_16UC1);
  for (auto& pixel : cv::Mat_<std::uint16_t>(image)) {
    pixel = static_cast<std::uint16_t>(pixels[0] << 8 | pixels[1]);
    pixels += 2;
  }
  return image;
}

cv::Mat Decode(const fs::path& file, const std::string& bytes) {
  cv::Mat image;
  std::string words = "its pixels cannot be decoded";
  try {
    const cv::Mat buffer(1, static_cast<int>(bytes.size()), CV_8UC1, const_cast<char*>(bytes.data()));
    image = cv::imdecode(buffer, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& error) {
    words = error.err;
  }
  if (image.empty()) throw FileError(file, "is damaged: " + words);
  return image;
}

std::string Size(const cv::Mat& image) { return std::to_string(image.cols) + "x" + std::to_string(image.rows); }
std::string Depth(const Frame& frame) { return frame.image.depth() == CV_8U ? "8-bit" : "16-bit"; }

int InferBitDepth(const cv::Mat& image) {
  if (image.depth() == CV_8U) return 8;
  double brightest = 0;
  cv::minMaxIdx(image, nullptr, &brightest);
  for (const int bits : {10, 12, 14}) {
    if (brightest < (1 << bits)) return bits;
  }
  return 16;
}

void CheckAlike(const Frame& first, const std::string& first_name, const Frame& second,
                const std::string& second_name) {
  if (first.image.size() != second.image.size()) {
    throw FileError(second.source, second_name + " is " + Size(second.image) + ", " + first_name + " (" + first.source +
                                       ") is " + Size(first.image) + "; both must have one size");
  }
  if (first.image.depth() != second.image.depth()) {
    throw FileError(second.source, second_name + " is " + Depth(second) + ", " + first_name + " (" + first.source +
                                       ") is " + Depth(first) + "; both must have one depth");
  }
}

}  // namespace

cv::Mat ReadImage(const fs::path& file) {
  const std::string bytes = ReadBytes(file);
  const cv::Mat image = CheckContainer(file, bytes) == ImageFormat::kPgm ? DecodePgm(file, bytes) : Decode(file, bytes);
  if (image.depth() != CV_8U && image.depth() != CV_16U) {
    throw FileError(file, "has pixels that are no unsigned 8- or 16-bit numbers");
  }
  return image;
}

Frame LoadFrame(const fs::path& file) {
  Frame frame;
  frame.image = ReadImage(file);
  if (frame.image.channels() != 1) {
    throw FileError(file, "is a colour picture (" + std::to_string(frame.image.channels()) +
                              " channels); one-channel grey of 8 or 16 bits is wanted");
  }
  frame.bit_depth = InferBitDepth(frame.image);
  frame.source = file.string();
  return frame;
}

FramePair LoadFramePair(const fs::path& left, const fs::path& right) {
  FramePair pair;
  pair.left = LoadFrame(left);
  pair.right = LoadFrame(right);
  CheckAlike(pair.left, "left", pair.right, "right");
  pair.left.bit_depth = pair.right.bit_depth = std::max(pair.left.bit_depth, pair.right.bit_depth);
  return pair;
}

FramePair LoadFramePair(const fs::path& left, const fs::path& right, const fs::path& ambient_left,
                        const fs::path& ambient_right) {
  FramePair pair = LoadFramePair(left, right);
  pair.ambient_left = LoadFrame(ambient_left);
  pair.ambient_right = LoadFrame(ambient_right);
  CheckAlike(pair.left, "left", *pair.ambient_left, "ambient left");
  CheckAlike(pair.right, "right", *pair.ambient_right, "ambient right");
  // Ambient frames are darker: their own brightest pixel says nothing about the camera's bits.
  const int bits = std::max({pair.left.bit_depth, pair.ambient_left->bit_depth, pair.ambient_right->bit_depth});
  pair.left.bit_depth = pair.right.bit_depth = pair.ambient_left->bit_depth = pair.ambient_right->bit_depth = bits;
  return pair;
}

void SaveFrame(const fs::path& file, const cv::Mat& image) {
  if (image.empty()) throw FileError(file, "cannot be written: the picture is empty");
  if ((image.depth() != CV_8U && image.depth() != CV_16U) || (image.channels() != 1 && image.channels() != 3)) {
    throw FileError(file, "cannot be written: pictures are 8- or 16-bit, grey or BGR");
  }
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  constexpr std::array<std::string_view, 4> kExtensions{".png", ".tif", ".tiff", ".pgm"};
  if (std::find(kExtensions.begin(), kExtensions.end(), extension) == kExtensions.end()) {
    throw FileError(file, "cannot be written: the name has to end in .png, .tif, .tiff or .pgm");
  }
  if (extension == ".pgm" && image.channels() != 1) throw FileError(file, "cannot be written: PGM is grey only");
  std::vector<std::uint8_t> bytes;
  try {
    if (!cv::imencode(extension, image, bytes)) throw FileError(file, "cannot be encoded as " + extension);
  } catch (const cv::Exception& error) {
    throw FileError(file, "cannot be encoded: " + error.err);
  }
  WriteBytes(file, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

}  // namespace granary
