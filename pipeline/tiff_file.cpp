// The directory is read first and must name strips that lie inside the file; then what it says is compared with what is
// read here, and only then are the strips unpacked, each into its rows of the picture.
#include "pipeline/tiff_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "pipeline/file_error.h"
#include "pipeline/picture_limits.h"
#include "pipeline/tiff_strips.h"

namespace granary {
namespace {

namespace fs = std::filesystem;

enum Tag : std::uint64_t {
  kWidth = 256,
  kHeight = 257,
  kBits = 258,
  kCompression = 259,
  kPhotometric = 262,
  kFillOrder = 266,
  kStripOffsets = 273,
  kOrientation = 274,
  kSamples = 277,
  kRowsPerStrip = 278,
  kStripSizes = 279,
  kPredictor = 317,
  kTileWidth = 322,
  kTileOffsets = 324,
  kTileSizes = 325,
  kSampleFormat = 339,
};

enum Compression : std::uint64_t { kNone = 1, kLzw = 5, kDeflate = 8, kOldDeflate = 32946, kPackBits = 32773 };

/// Reads numbers of a TIFF in its own byte order; nothing when they lie beyond the end.
class TiffNumbers {
 public:
  explicit TiffNumbers(std::string_view bytes) : bytes_(bytes), little_(bytes[0] == 'I') {}
  [[nodiscard]] std::optional<std::uint64_t> Get(std::uint64_t at, int size) const {
    if (at > bytes_.size() || static_cast<std::uint64_t>(size) > bytes_.size() - at) return std::nullopt;
    std::uint64_t value = 0;
    for (int i = 0; i < size; ++i) {
      const std::size_t place = static_cast<std::size_t>(at) + (little_ ? size - 1 - i : i);
      value = value << 8 | static_cast<std::uint8_t>(bytes_[place]);
    }
    return value;
  }
  [[nodiscard]] bool little() const { return little_; }

 private:
  std::string_view bytes_;
  bool little_;
};

struct Entry {
  std::uint64_t type = 0, count = 0, at = 0;  ///< `at`: where the values lie
};
using Directory = std::map<std::uint64_t, Entry>;

/// Bytes of one value; 0 for a type that is not in the specification.
int TypeSize(std::uint64_t type) {
  constexpr std::array<int, 19> kSizes{0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8};
  return type < kSizes.size() ? kSizes[type] : 0;
}

/// The entries of the first picture, each with its values inside the file. Source: TIFF 6.0, section 2.
std::optional<Directory> ReadDirectory(std::string_view bytes, const TiffNumbers& numbers) {
  if (bytes.size() < 16) return std::nullopt;
  const bool big = *numbers.Get(2, 2) == 43;
  const int offset_size = big ? 8 : 4;
  const int count_size = big ? 8 : 2;
  const int entry_size = big ? 20 : 12;
  const auto folder = numbers.Get(big ? 8 : 4, offset_size);
  if (!folder) return std::nullopt;
  const auto entries = numbers.Get(*folder, count_size);
  if (!entries || *entries > 4096) return std::nullopt;

  Directory directory;
  for (std::uint64_t i = 0; i < *entries; ++i) {
    const std::uint64_t at = *folder + count_size + i * entry_size;
    const auto tag = numbers.Get(at, 2);
    const auto type = numbers.Get(at + 2, 2);
    const auto count = numbers.Get(at + 4, offset_size);
    const std::uint64_t inline_at = at + entry_size - offset_size;
    if (!tag || !type || !count || !numbers.Get(inline_at, offset_size)) return std::nullopt;
    const int size = TypeSize(*type);
    if (size == 0 || *count > bytes.size()) return std::nullopt;
    const bool fits_inline = *count * size <= static_cast<std::uint64_t>(offset_size);
    const Entry entry{*type, *count, fits_inline ? inline_at : *numbers.Get(inline_at, offset_size)};
    if (entry.at > bytes.size() || entry.count * size > bytes.size() - entry.at) return std::nullopt;
    directory.emplace(*tag, entry);
  }
  // The place of the next picture is the directory's last field; a file cut there is not whole.
  if (!numbers.Get(*folder + count_size + *entries * entry_size, offset_size)) return std::nullopt;
  return directory;
}

/// One value of an entry of whole numbers without sign; nothing when it has fewer values or is of another type.
std::optional<std::uint64_t> Value(const TiffNumbers& numbers, const Entry& entry, std::uint64_t i) {
  const bool whole_number = entry.type == 1 || entry.type == 3 || entry.type == 4 || entry.type == 16;
  if (!whole_number || i >= entry.count) return std::nullopt;
  const int size = TypeSize(entry.type);
  return numbers.Get(entry.at + i * size, size);
}

/// The packed bytes of every strip (or tile), all inside the file. Source: TIFF 6.0, sections 3 and 15.
std::optional<std::vector<std::string_view>> Pieces(std::string_view bytes, const TiffNumbers& numbers,
                                                    const Directory& directory) {
  const bool tiles = directory.contains(kTileOffsets);
  const auto offsets = directory.find(tiles ? kTileOffsets : kStripOffsets);
  const auto sizes = directory.find(tiles ? kTileSizes : kStripSizes);
  if (offsets == directory.end() || sizes == directory.end()) return std::nullopt;
  if (offsets->second.count == 0 || offsets->second.count != sizes->second.count) return std::nullopt;
  std::vector<std::string_view> pieces;
  for (std::uint64_t i = 0; i < offsets->second.count; ++i) {
    const auto start = Value(numbers, offsets->second, i);
    const auto length = Value(numbers, sizes->second, i);
    if (!start || !length || *start > bytes.size() || *length > bytes.size() - *start) return std::nullopt;
    pieces.push_back(bytes.substr(static_cast<std::size_t>(*start), static_cast<std::size_t>(*length)));
  }
  return pieces;
}

/// What decides how the strips become pixels.
struct Layout {
  std::uint64_t width = 0, height = 0, bits = 1, compression = kNone, rows_per_strip = 0;
  bool differences = false;  ///< a pixel is stored as its difference to the one on its left
};

/// @throws FileError for everything that is stored in another way than is read here
Layout ReadLayout(const fs::path& file, const TiffNumbers& numbers, const Directory& directory) {
  const auto number = [&](Tag tag, std::optional<std::uint64_t> otherwise) {
    const auto entry = directory.find(tag);
    const auto value = entry == directory.end() ? otherwise : Value(numbers, entry->second, 0);
    if (!value) throw FileError(file, "is a damaged TIFF: tag " + std::to_string(tag) + " is missing or no number");
    return *value;
  };
  const auto refuse = [&](const std::string& what, std::uint64_t value, const std::string& allowed) {
    throw FileError(file, "is a TIFF with " + what + " " + std::to_string(value) + "; " + allowed);
  };
  const std::string grey = "one-channel grey of 8 or 16 bits is wanted";

  Layout layout;
  layout.width = number(kWidth, std::nullopt);
  layout.height = number(kHeight, std::nullopt);
  CheckPictureSize(file, layout.width, layout.height);

  const std::uint64_t samples = number(kSamples, 1);
  const std::uint64_t photometric = number(kPhotometric, std::nullopt);
  if (samples != 1) throw FileError(file, "is a colour picture (" + std::to_string(samples) + " channels); " + grey);
  if (photometric == 3) throw FileError(file, "is a colour picture (with a palette); " + grey);
  if (photometric == 0) throw FileError(file, "is a TIFF stored as a negative (MinIsWhite); MinIsBlack is wanted");
  if (photometric != 1) refuse("photometric interpretation", photometric, "1 (MinIsBlack) is wanted");
  layout.bits = number(kBits, 1);
  if ((layout.bits != 8 && layout.bits != 16) || number(kSampleFormat, 1) != 1) {
    throw FileError(file, "has pixels that are no unsigned 8- or 16-bit numbers");
  }

  if (directory.contains(kTileWidth) || directory.contains(kTileOffsets)) {
    throw FileError(file, "is a TIFF in tiles; strips are wanted");
  }
  layout.compression = number(kCompression, kNone);
  const bool differs =
      layout.compression == kLzw || layout.compression == kDeflate || layout.compression == kOldDeflate;
  if (!differs && layout.compression != kNone && layout.compression != kPackBits) {
    refuse("compression", layout.compression, "1 (none), 5 (LZW), 8 (Deflate) and 32773 (PackBits) are read");
  }
  const std::uint64_t predictor = number(kPredictor, 1);
  if (predictor != 1 && (predictor != 2 || !differs)) {
    refuse("predictor", predictor, "1 (none) is read, and 2 (horizontal) with LZW or Deflate");
  }
  layout.differences = predictor == 2;
  const std::uint64_t fill_order = number(kFillOrder, 1);
  if (fill_order != 1) refuse("fill order", fill_order, "1 (highest bit first) is wanted");
  const std::uint64_t orientation = number(kOrientation, 1);
  if (orientation != 1) refuse("orientation", orientation, "1 (not turned, not mirrored) is wanted");

  layout.rows_per_strip = std::min(number(kRowsPerStrip, layout.height), layout.height);
  if (layout.rows_per_strip == 0) throw FileError(file, "is a damaged TIFF: its strips have no rows");
  return layout;
}

bool Unpack(std::uint64_t compression, std::string_view packed, std::span<std::uint8_t> to) {
  switch (compression) {
    case kLzw:
      return UnpackLzw(packed, to);
    case kPackBits:
      return UnpackBytes(packed, to);
    case kNone:
      if (packed.size() < to.size()) return false;
      std::memcpy(to.data(), packed.data(), to.size());
      return true;
    default:
      return UnpackDeflate(packed, to);
  }
}

void SwapBytes(cv::Mat_<std::uint16_t> image) {
  for (auto& pixel : image) pixel = static_cast<std::uint16_t>(pixel << 8 | pixel >> 8);
}

/// Undoes predictor 2; sums wrap around, as the differences did. Source: TIFF 6.0, section 14.
template <typename Pixel>
void SumAlongRows(cv::Mat_<Pixel> image) {
  for (int v = 0; v < image.rows; ++v) {
    Pixel* row = image[v];
    for (int u = 1; u < image.cols; ++u) row[u] = static_cast<Pixel>(row[u] + row[u - 1]);
  }
}

}  // namespace

cv::Mat DecodeTiff(const fs::path& file, std::string_view bytes) {
  const std::string not_whole = "is a truncated or damaged TIFF";
  const TiffNumbers numbers(bytes);
  const auto directory = ReadDirectory(bytes, numbers);
  if (!directory) throw FileError(file, not_whole);
  const auto strips = Pieces(bytes, numbers, *directory);
  if (!strips) throw FileError(file, not_whole);
  const Layout layout = ReadLayout(file, numbers, *directory);
  const std::uint64_t wanted = (layout.height + layout.rows_per_strip - 1) / layout.rows_per_strip;
  if (strips->size() != wanted) {
    throw FileError(file, "is a damaged TIFF: it has " + std::to_string(strips->size()) + " strips, its header says " +
                              std::to_string(wanted));
  }

  cv::Mat image(static_cast<int>(layout.height), static_cast<int>(layout.width), layout.bits == 8 ? CV_8UC1 : CV_16UC1);
  const std::size_t row_bytes = static_cast<std::size_t>(layout.width) * image.elemSize();
  for (std::size_t i = 0; i < strips->size(); ++i) {
    const std::size_t first_row = i * static_cast<std::size_t>(layout.rows_per_strip);
    const std::size_t rows = std::min<std::size_t>(layout.rows_per_strip, layout.height - first_row);
    if (!Unpack(layout.compression, (*strips)[i], {image.ptr(static_cast<int>(first_row)), rows * row_bytes})) {
      throw FileError(file, "is damaged: strip " + std::to_string(i + 1) + " of " + std::to_string(strips->size()) +
                                " does not unpack to its " + std::to_string(rows * row_bytes) + " bytes");
    }
  }
  if (layout.bits == 16 && numbers.little() != (std::endian::native == std::endian::little)) SwapBytes(image);
  if (layout.differences && layout.bits == 8) SumAlongRows<std::uint8_t>(image);
  if (layout.differences && layout.bits == 16) SumAlongRows<std::uint16_t>(image);
  return image;
}

}  // namespace granary
