// libpng reports a fault by longjmp, which runs no destructor. So the two functions that call setjmp hold plain values
// only; handles, buffers and pictures belong to their callers, and no exception ever crosses libpng's frames.
// Reading first walks the chunks: what is truncated or has a wrong checksum is said in our words, before any decoding.
#include "pipeline/png_file.h"

#include <png.h>
#include <zlib.h>

#include <bit>
#include <csetjmp>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <exception>
#include <vector>

#include <opencv2/core.hpp>

#include "pipeline/file_error.h"
#include "pipeline/picture_limits.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kSignatureSize = 8;
constexpr bool kLittleEndian = std::endian::native == std::endian::little;

std::uint32_t BigEndian32(std::string_view bytes, std::size_t at) {
  return png_get_uint_32(reinterpret_cast<png_const_bytep>(bytes.data()) + at);
}

std::uint32_t Checksum(std::string_view bytes) {
  return static_cast<std::uint32_t>(::crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

/// From the first chunk, which says the size, to IEND. Source: PNG specification, sections 5.3 and 11.2.2.
void CheckChunks(const fs::path& file, std::string_view bytes) {
  const std::string truncated = "is a truncated PNG (it ends after " + std::to_string(bytes.size()) + " bytes)";
  bool has_pixels = false;
  for (std::size_t at = kSignatureSize;;) {
    if (at + 12 > bytes.size()) throw FileError(file, truncated);
    const std::uint32_t length = BigEndian32(bytes, at);
    if (length > bytes.size() - at - 12) throw FileError(file, truncated);
    const std::string_view type = bytes.substr(at + 4, 4);
    if (Checksum(bytes.substr(at + 4, 4 + std::size_t{length})) != BigEndian32(bytes, at + 8 + length)) {
      throw FileError(file, "is a damaged PNG (wrong checksum at byte " + std::to_string(at) + ")");
    }
    if (at == kSignatureSize) {
      if (type != "IHDR" || length != 13) throw FileError(file, "is a damaged PNG (its header is not the first chunk)");
      CheckPictureSize(file, BigEndian32(bytes, at + 8), BigEndian32(bytes, at + 12));
    }
    has_pixels = has_pixels || type == "IDAT";
    if (type == "IEND") break;
    at += 12 + std::size_t{length};
  }
  if (!has_pixels) throw FileError(file, "is a PNG without pixels");
}

/// libpng's words on what went wrong; plain memory, as the jump leaves no time for anything else.
struct Fault {
  char words[128] = "";
};

[[noreturn]] void OnError(png_structp png, png_const_charp words) {
  auto* fault = static_cast<Fault*>(png_get_error_ptr(png));
  std::snprintf(fault->words, sizeof(fault->words), "%s", words);
  png_longjmp(png, 1);
}
void OnWarning(png_structp, png_const_charp) {}  // on metadata only: faults of the pixels are made errors below

struct Source {
  const char* next = nullptr;
  std::size_t left = 0;
};

void Read(png_structp png, png_bytep to, std::size_t size) {
  auto* source = static_cast<Source*>(png_get_io_ptr(png));
  if (size > source->left) png_error(png, "it ends too early");
  std::memcpy(to, source->next, size);
  source->next += size;
  source->left -= size;
}

void Append(png_structp png, png_bytep from, std::size_t size) {
  bool appended = true;
  try {
    static_cast<std::string*>(png_get_io_ptr(png))->append(reinterpret_cast<const char*>(from), size);
  } catch (const std::exception&) {
    appended = false;
  }
  if (!appended) png_error(png, "out of memory");
}
void Flush(png_structp) {}

/// libpng's two handles, freed on every path.
struct Reader {
  Fault fault;
  Source source;
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &fault, OnError, OnWarning);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  Reader() = default;
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
  ~Reader() { png_destroy_read_struct(&png, &info, nullptr); }
};
struct Writer {
  Fault fault;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &fault, OnError, OnWarning);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  Writer() = default;
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
  ~Writer() { png_destroy_write_struct(&png, &info); }
};

/// Everything before the pixels. False: see reader.fault.
bool ReadHeader(Reader& reader) {
  if (reader.png == nullptr || reader.info == nullptr) return false;
  if (setjmp(png_jmpbuf(reader.png)) != 0) return false;
  png_set_read_fn(reader.png, &reader.source, Read);
  png_set_benign_errors(reader.png, 0);  // what libpng would repair in silence is an error
  png_set_keep_unknown_chunks(reader.png, PNG_HANDLE_CHUNK_NEVER, nullptr, -1);
  png_read_info(reader.png, reader.info);

  const int colour = png_get_color_type(reader.png, reader.info);
  if (colour == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(reader.png);  // with its transparency, if it has one
  if (colour == PNG_COLOR_TYPE_GRAY) png_set_expand_gray_1_2_4_to_8(reader.png);
  if (colour == PNG_COLOR_TYPE_GRAY_ALPHA) png_set_gray_to_rgb(reader.png);
  if (colour != PNG_COLOR_TYPE_GRAY) png_set_bgr(reader.png);
  if (kLittleEndian) png_set_swap(reader.png);
  png_set_interlace_handling(reader.png);
  png_read_update_info(reader.png, reader.info);
  return true;
}

bool ReadPixels(Reader& reader, png_bytepp rows) {
  if (setjmp(png_jmpbuf(reader.png)) != 0) return false;
  png_read_image(reader.png, rows);
  png_read_end(reader.png, nullptr);
  return true;
}

bool Write(Writer& writer, std::string& bytes, const cv::Mat& image, png_bytepp rows) {
  if (writer.png == nullptr || writer.info == nullptr) return false;
  if (setjmp(png_jmpbuf(writer.png)) != 0) return false;
  png_set_write_fn(writer.png, &bytes, Append, Flush);
  // Speed before size: pictures are saved between two measurements, and camera noise does not compress anyway.
  png_set_compression_level(writer.png, Z_BEST_SPEED);
  png_set_filter(writer.png, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
  png_set_IHDR(writer.png, writer.info, static_cast<png_uint_32>(image.cols), static_cast<png_uint_32>(image.rows),
               image.depth() == CV_16U ? 16 : 8, image.channels() == 3 ? PNG_COLOR_TYPE_RGB : PNG_COLOR_TYPE_GRAY,
               PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(writer.png, writer.info);
  if (image.channels() == 3) png_set_bgr(writer.png);
  if (kLittleEndian && image.depth() == CV_16U) png_set_swap(writer.png);
  png_write_image(writer.png, rows);
  png_write_end(writer.png, nullptr);
  return true;
}

std::vector<png_bytep> RowsOf(const cv::Mat& image) {
  std::vector<png_bytep> rows;
  for (int v = 0; v < image.rows; ++v) rows.push_back(const_cast<png_bytep>(image.ptr(v)));
  return rows;
}

std::string Words(const Fault& fault) { return fault.words[0] != '\0' ? fault.words : "libpng is out of memory"; }

}  // namespace

cv::Mat DecodePng(const fs::path& file, std::string_view bytes) {
  CheckChunks(file, bytes);
  Reader reader;
  reader.source = {bytes.data(), bytes.size()};
  if (!ReadHeader(reader)) throw FileError(file, "is damaged: " + Words(reader.fault));
  const int depth = png_get_bit_depth(reader.png, reader.info) == 16 ? CV_16U : CV_8U;
  cv::Mat image(static_cast<int>(png_get_image_height(reader.png, reader.info)),
                static_cast<int>(png_get_image_width(reader.png, reader.info)),
                CV_MAKETYPE(depth, png_get_channels(reader.png, reader.info)));
  // The rows below are written with libpng's own idea of their length.
  if (png_get_rowbytes(reader.png, reader.info) != static_cast<std::size_t>(image.cols) * image.elemSize()) {
    throw FileError(file, "is damaged: its rows do not have the length its header says");
  }
  std::vector<png_bytep> rows = RowsOf(image);
  if (!ReadPixels(reader, rows.data())) throw FileError(file, "is damaged: " + Words(reader.fault));
  return image;
}

std::string EncodePng(const fs::path& file, const cv::Mat& image) {
  std::string bytes;
  std::vector<png_bytep> rows = RowsOf(image);
  Writer writer;
  if (!Write(writer, bytes, image, rows.data())) throw FileError(file, "cannot be encoded: " + Words(writer.fault));
  return bytes;
}

}  // namespace granary
