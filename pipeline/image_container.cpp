// Only what decides wholeness is parsed: lengths, offsets, checksums. Pixels are the decoder's business.
#include "pipeline/image_container.h"

#include <array>
#include <cctype>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "pipeline/file_error.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kPngSignature("\x89PNG\r\n\x1a\n", 8);
constexpr std::int64_t kLargestSide = 65535;

std::uint8_t Byte(std::string_view bytes, std::size_t at) { return static_cast<std::uint8_t>(bytes[at]); }

std::uint32_t BigEndian32(std::string_view bytes, std::size_t at) {
  return std::uint32_t{Byte(bytes, at)} << 24 | std::uint32_t{Byte(bytes, at + 1)} << 16 |
         std::uint32_t{Byte(bytes, at + 2)} << 8 | Byte(bytes, at + 3);
}

/// CRC-32 as PNG uses it (ISO 3309). Source: PNG specification, annex D.
std::uint32_t Crc32(std::string_view bytes) {
  static const std::array<std::uint32_t, 256> kTable = [] {
    std::array<std::uint32_t, 256> table{};
    for (std::uint32_t n = 0; n < table.size(); ++n) {
      std::uint32_t c = n;
      for (int bit = 0; bit < 8; ++bit) c = (c & 1) != 0 ? 0xEDB88320U ^ (c >> 1) : c >> 1;
      table[n] = c;
    }
    return table;
  }();
  std::uint32_t crc = 0xFFFFFFFFU;
  for (const char c : bytes) crc = kTable[(crc ^ static_cast<std::uint8_t>(c)) & 0xFF] ^ (crc >> 8);
  return crc ^ 0xFFFFFFFFU;
}

void CheckPng(const fs::path& file, std::string_view bytes) {
  const std::string truncated = "is a truncated PNG (it ends after " + std::to_string(bytes.size()) + " bytes)";
  bool has_pixels = false;
  for (std::size_t at = kPngSignature.size();;) {
    if (at + 12 > bytes.size()) throw FileError(file, truncated);
    const std::uint32_t length = BigEndian32(bytes, at);
    if (length > bytes.size() - at - 12) throw FileError(file, truncated);
    const std::string_view type = bytes.substr(at + 4, 4);
    if (Crc32(bytes.substr(at + 4, 4 + length)) != BigEndian32(bytes, at + 8 + length)) {
      throw FileError(file, "is a damaged PNG (wrong checksum at byte " + std::to_string(at) + ")");
    }
    has_pixels = has_pixels || type == "IDAT";
    if (type == "IEND") break;
    at += 12 + length;
  }
  if (!has_pixels) throw FileError(file, "is a PNG without pixels");
}

/// Reads numbers of a TIFF in its own byte order; nothing when they lie beyond the end.
class TiffNumbers {
 public:
  explicit TiffNumbers(std::string_view bytes) : bytes_(bytes), little_(bytes[0] == 'I') {}
  [[nodiscard]] std::optional<std::uint64_t> Get(std::uint64_t at, int size) const {
    if (at > bytes_.size() || static_cast<std::uint64_t>(size) > bytes_.size() - at) return std::nullopt;
    std::uint64_t value = 0;
    for (int i = 0; i < size; ++i) {
      value = value << 8 | Byte(bytes_, static_cast<std::size_t>(at) + (little_ ? size - 1 - i : i));
    }
    return value;
  }

 private:
  std::string_view bytes_;
  bool little_;
};

struct TiffEntry {
  std::uint64_t type = 0, count = 0, at = 0;  ///< `at`: where the values lie
};

/// Bytes of one value; 0 for a type that is not in the specification.
int TiffTypeSize(std::uint64_t type) {
  constexpr std::array<int, 19> kSizes{0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8};
  return type < kSizes.size() ? kSizes[type] : 0;
}

/// True when every strip or tile of the first picture lies inside the file. Source: TIFF 6.0, sections 2 and 8.
bool TiffIsWhole(std::string_view bytes) {
  if (bytes.size() < 16) return false;
  const TiffNumbers numbers(bytes);
  const bool big = *numbers.Get(2, 2) == 43;
  const int offset_size = big ? 8 : 4;
  const int count_size = big ? 8 : 2;
  const int entry_size = big ? 20 : 12;
  const auto folder = numbers.Get(big ? 8 : 4, offset_size);
  if (!folder) return false;
  const auto entries = numbers.Get(*folder, count_size);
  if (!entries || *entries > 4096) return false;

  std::optional<TiffEntry> offsets, sizes;
  for (std::uint64_t i = 0; i < *entries; ++i) {
    const std::uint64_t at = *folder + count_size + i * entry_size;
    const auto tag = numbers.Get(at, 2);
    const auto type = numbers.Get(at + 2, 2);
    const auto count = numbers.Get(at + 4, offset_size);
    if (!tag || !type || !count || !numbers.Get(at + entry_size - offset_size, offset_size)) return false;
    const int size = TiffTypeSize(*type);
    if (size == 0 || *count > bytes.size()) return false;
    const std::uint64_t inline_at = at + entry_size - offset_size;
    const bool fits_inline = *count * size <= static_cast<std::uint64_t>(offset_size);
    const TiffEntry entry{*type, *count, fits_inline ? inline_at : *numbers.Get(inline_at, offset_size)};
    if (entry.at > bytes.size() || entry.count * size > bytes.size() - entry.at) return false;
    if (*tag == 273 || *tag == 324) offsets = entry;  // StripOffsets, TileOffsets
    if (*tag == 279 || *tag == 325) sizes = entry;    // StripByteCounts, TileByteCounts
  }
  if (!numbers.Get(*folder + count_size + *entries * entry_size, offset_size))
    return false;  // the next picture's place
  if (!offsets || !sizes || offsets->count == 0 || offsets->count != sizes->count) return false;
  for (std::uint64_t i = 0; i < offsets->count; ++i) {
    const int offset_bytes = TiffTypeSize(offsets->type), size_bytes = TiffTypeSize(sizes->type);
    const auto start = numbers.Get(offsets->at + i * offset_bytes, offset_bytes);
    const auto length = numbers.Get(sizes->at + i * size_bytes, size_bytes);
    if (!start || !length || *start > bytes.size() || *length > bytes.size() - *start) return false;
  }
  return true;
}

/// The next number of a PNM header; skips white space and comments.
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
    if (*value > kLargestSide) return std::nullopt;
  }
  return value;
}

}  // namespace

PgmHeader ParsePgm(const fs::path& file, std::string_view bytes) {
  std::size_t at = 2;
  const auto width = NextNumber(bytes, at);
  const auto height = NextNumber(bytes, at);
  const auto maximum = NextNumber(bytes, at);
  if (!width || !height || !maximum || *width < 1 || *height < 1 || *maximum < 1 || at >= bytes.size()) {
    throw FileError(file, "is a PGM with a damaged header; width, height and maximum of 1 to 65535 are wanted");
  }
  const PgmHeader header{*width, *height, *maximum, at + 1};  // one white space ends the header
  const std::size_t wanted = std::size_t(*width) * std::size_t(*height) * (*maximum > 255 ? 2 : 1);
  const std::size_t present = bytes.size() - header.pixels_at;
  if (present != wanted) {
    throw FileError(file, std::string(present < wanted ? "is a truncated PGM" : "is a damaged PGM") +
                              ": its header says " + std::to_string(wanted) + " bytes of pixels, it has " +
                              std::to_string(present));
  }
  return header;
}

ImageFormat CheckContainer(const fs::path& file, std::string_view bytes) {
  if (bytes.substr(0, 8) == kPngSignature) {
    CheckPng(file, bytes);
    return ImageFormat::kPng;
  }
  const std::string_view four = bytes.substr(0, 4);
  for (const std::string_view magic : {std::string_view("II*\0", 4), std::string_view("MM\0*", 4),
                                       std::string_view("II+\0", 4), std::string_view("MM\0+", 4)}) {
    if (four != magic) continue;
    if (!TiffIsWhole(bytes)) throw FileError(file, "is a truncated or damaged TIFF");
    return ImageFormat::kTiff;
  }
  if (four.substr(0, 2) == "P5") {
    static_cast<void>(ParsePgm(file, bytes));
    return ImageFormat::kPgm;
  }
  if (four.substr(0, 2) == "P6" || four.substr(0, 2) == "P3") {
    throw FileError(file, "is a colour picture (PPM); one-channel grey of 8 or 16 bits is wanted");
  }
  throw FileError(file, "is no PNG, TIFF or binary PGM (P5)");
}

}  // namespace granary
