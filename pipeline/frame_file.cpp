// Whole files are decoded from memory and encoded to memory. Not by OpenCV's codecs: Debian's load GDAL, and behind it
// GPL libraries, and hand out partly decoded pictures.
#include "pipeline/frame_file.h"

#include <algorithm>
#include <cctype>
#include <string>
#include <string_view>

#include <opencv2/core.hpp>

#include "pipeline/file_bytes.h"
#include "pipeline/file_error.h"
#include "pipeline/pgm_file.h"
#include "pipeline/png_file.h"
#include "pipeline/tiff_file.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

/// The picture by the format that the file's first bytes name; its extension is not asked.
cv::Mat Decode(const fs::path& file, std::string_view bytes) {
  if (bytes.starts_with("\x89PNG\r\n\x1a\n")) return DecodePng(file, bytes);
  const std::string_view four = bytes.substr(0, 4);
  for (const std::string_view magic : {std::string_view("II*\0", 4), std::string_view("MM\0*", 4),
                                       std::string_view("II+\0", 4), std::string_view("MM\0+", 4)}) {
    if (four == magic) return DecodeTiff(file, bytes);
  }
  if (bytes.starts_with("P5")) return DecodePgm(file, bytes);
  if (bytes.starts_with("P6") || bytes.starts_with("P3")) {
    throw FileError(file, "is a colour picture (PPM); one-channel grey of 8 or 16 bits is wanted");
  }
  throw FileError(file, "is no PNG, TIFF or binary PGM (P5)");
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
  try {
    return Decode(file, bytes);
  } catch (const cv::Exception& error) {  // OpenCV's word for too little memory
    throw FileError(file, "cannot be read: " + error.err);
  }
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
  if (extension == ".png") return WriteBytes(file, EncodePng(file, image));
  if (extension != ".pgm") throw FileError(file, "cannot be written: the name has to end in .png or .pgm");
  if (image.channels() != 1) throw FileError(file, "cannot be written: PGM is grey only");
  WriteBytes(file, EncodePgm(image));
}

}  // namespace granary
