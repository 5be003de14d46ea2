// One loop over rows; a layout is how it reads the pixels of one. Bits that no picture of that layout can have set show
// that the format was wrongly declared, so they are collected on the way and end in an error.
#include "drivers/pixel_formats.h"

#include <algorithm>
#include <array>
#include <memory>
#include <stdexcept>

#include <turbojpeg.h>

namespace granary {
namespace {

struct LayoutInfo {
  PixelLayout layout;
  int bits;
  std::string_view genicam, v4l2;  // the first of each is the layout's name in messages; empty: has none there
};

constexpr std::array<LayoutInfo, 14> kLayouts{{
    {PixelLayout::kMono8, 8, "Mono8", "GREY"},
    {PixelLayout::kMono10, 10, "Mono10", "Y10"},
    {PixelLayout::kMono12, 12, "Mono12", "Y12"},
    {PixelLayout::kMono14, 14, "Mono14", "Y14"},
    {PixelLayout::kMono16, 16, "Mono16", "Y16"},
    {PixelLayout::kMono10p, 10, "Mono10p", ""},
    {PixelLayout::kMono12p, 12, "Mono12p", ""},
    {PixelLayout::kMono10Packed, 10, "Mono10Packed", ""},
    {PixelLayout::kMono12Packed, 12, "Mono12Packed", ""},
    {PixelLayout::kMipi10, 10, "", "Y10P"},
    {PixelLayout::kYuyv, 8, "YUV422_8", "YUYV"},
    {PixelLayout::kYuyv, 8, "YCbCr422_8", ""},
    {PixelLayout::kJpeg, 8, "", "MJPG"},
    {PixelLayout::kJpeg, 8, "", "JPEG"},
}};

const LayoutInfo& InfoOf(PixelLayout layout) {
  const auto* const info =
      std::find_if(kLayouts.begin(), kLayouts.end(), [&](const auto& row) { return row.layout == layout; });
  if (info == kLayouts.end()) throw std::logic_error("no such pixel layout");
  return *info;
}

std::string NameOf(PixelLayout layout) {
  const LayoutInfo& info = InfoOf(layout);
  return std::string(info.genicam.empty() ? info.v4l2 : info.genicam);
}

std::string Words(cv::Size size) { return std::to_string(size.width) + "x" + std::to_string(size.height); }

/// Little-endian 16-bit words.
void ReadWords(const std::uint8_t* row, std::uint16_t* grey, int width) {
  for (int x = 0; x < width; ++x) grey[x] = static_cast<std::uint16_t>(row[2 * x] | row[2 * x + 1] << 8);
}

/// A stream of bits, least significant first.
template <int kBits>
void ReadLsbFirst(const std::uint8_t* row, std::uint16_t* grey, int width) {
  std::uint32_t pool = 0;
  int held = 0;
  for (int x = 0; x < width; ++x) {
    for (; held < kBits; held += 8) pool |= static_cast<std::uint32_t>(*row++) << held;
    grey[x] = static_cast<std::uint16_t>(pool & ((1U << kBits) - 1));
    pool >>= kBits;
    held -= kBits;
  }
}

/// Two pixels in three bytes: the high bits of each in a byte of its own, the low bits in the halves of the one
/// between. A pixel of 10 bits leaves two bits of its half unused; set, they come out above the tenth bit.
template <int kBits>
void ReadPairs(const std::uint8_t* row, std::uint16_t* grey, int width) {
  constexpr int kLow = kBits - 8;
  const auto value = [](std::uint8_t high, int half) {
    const int low = half & ((1 << kLow) - 1), unused = half >> kLow;
    return static_cast<std::uint16_t>(high << kLow | low | unused << kBits);
  };
  for (int x = 0; x < width; ++x) {
    const std::uint8_t* const group = row + x / 2 * 3;
    grey[x] = x % 2 == 0 ? value(group[0], group[1] & 0xF) : value(group[2], group[1] >> 4);
  }
}

/// Four pixels in five bytes: four times the high bits, then the low bits of all.
void ReadMipi10(const std::uint8_t* row, std::uint16_t* grey, int width) {
  for (int x = 0; x < width; ++x) {
    const std::uint8_t* const group = row + x / 4 * 5;
    grey[x] = static_cast<std::uint16_t>(group[x % 4] << 2 | (group[4] >> (x % 4 * 2) & 3));
  }
}

using WideReader = void (*)(const std::uint8_t*, std::uint16_t*, int);

WideReader WideReaderOf(PixelLayout layout) {
  switch (layout) {
    case PixelLayout::kMono10p:
      return ReadLsbFirst<10>;
    case PixelLayout::kMono12p:
      return ReadLsbFirst<12>;
    case PixelLayout::kMono10Packed:
      return ReadPairs<10>;
    case PixelLayout::kMono12Packed:
      return ReadPairs<12>;
    case PixelLayout::kMipi10:
      return ReadMipi10;
    default:
      return ReadWords;
  }
}

cv::Mat ReadNarrow(const std::uint8_t* bytes, cv::Size size, std::size_t row_bytes, int step) {
  cv::Mat grey(size, CV_8UC1);
  for (int y = 0; y < size.height; ++y) {
    const std::uint8_t* const from = bytes + static_cast<std::size_t>(y) * row_bytes;
    auto* const to = grey.ptr<std::uint8_t>(y);
    for (int x = 0; x < size.width; ++x) to[x] = from[x * step];
  }
  return grey;
}

cv::Mat ReadWide(const std::uint8_t* bytes, PixelLayout layout, cv::Size size, std::size_t row_bytes) {
  cv::Mat grey(size, CV_16UC1);
  const WideReader read = WideReaderOf(layout);
  unsigned bits_seen = 0;
  for (int y = 0; y < size.height; ++y) {
    auto* const to = grey.ptr<std::uint16_t>(y);
    read(bytes + static_cast<std::size_t>(y) * row_bytes, to, size.width);
    for (int x = 0; x < size.width; ++x) bits_seen |= to[x];
  }
  if (bits_seen >> BitDepthOf(layout) != 0) {
    throw std::invalid_argument(NameOf(layout) + ": a pixel has more than " + std::to_string(BitDepthOf(layout)) +
                                " bits; the picture is of another format");
  }
  return grey;
}

/// A half picture is none: whatever libjpeg merely warns of is an error here. Frames without Huffman tables, as many
/// USB cameras send them, get the standard ones from the library.
cv::Mat ReadJpeg(std::span<const std::byte> bytes, cv::Size size) {
  const std::unique_ptr<void, int (*)(tjhandle)> decoder(tjInitDecompress(), tjDestroy);
  if (!decoder) throw std::runtime_error(std::string("TurboJPEG: ") + tjGetErrorStr2(nullptr));
  const auto require = [&](bool ok) {
    if (!ok) throw std::invalid_argument(std::string("JPEG: ") + tjGetErrorStr2(decoder.get()));
  };
  const auto* const data = reinterpret_cast<const unsigned char*>(bytes.data());
  cv::Size found;
  int subsampling = 0, colours = 0;
  require(tjDecompressHeader3(decoder.get(), data, bytes.size(), &found.width, &found.height, &subsampling, &colours) ==
          0);
  if (found != size) throw std::invalid_argument("JPEG: is " + Words(found) + " pixels, expected is " + Words(size));
  cv::Mat grey(size, CV_8UC1);
  require(tjDecompress2(decoder.get(), data, bytes.size(), grey.data, size.width, static_cast<int>(grey.step),
                        size.height, TJPF_GRAY, TJFLAG_STOPONWARNING | TJFLAG_LIMITSCANS) == 0);
  return grey;
}

}  // namespace

int BitDepthOf(PixelLayout layout) { return InfoOf(layout).bits; }

std::size_t RowBytesOf(PixelLayout layout, int width) {
  const auto pixels = static_cast<std::size_t>(std::max(width, 0));
  switch (layout) {
    case PixelLayout::kMono8:
      return pixels;
    case PixelLayout::kMono10:
    case PixelLayout::kMono12:
    case PixelLayout::kMono14:
    case PixelLayout::kMono16:
      return pixels * 2;
    case PixelLayout::kMono10p:
      return (pixels * 10 + 7) / 8;
    case PixelLayout::kMono12p:
    case PixelLayout::kMono10Packed:
    case PixelLayout::kMono12Packed:
      return (pixels * 12 + 7) / 8;
    case PixelLayout::kMipi10:
      return (pixels + 3) / 4 * 5;
    case PixelLayout::kYuyv:
      return (pixels + 1) / 2 * 4;
    case PixelLayout::kJpeg:
      return 0;
  }
  throw std::logic_error("no such pixel layout");
}

std::optional<PixelLayout> LayoutOfGenicam(std::string_view name) {
  for (const LayoutInfo& info : kLayouts) {
    if (!name.empty() && info.genicam == name) return info.layout;
  }
  return std::nullopt;
}

std::optional<PixelLayout> LayoutOfV4l2(std::string_view four_characters) {
  while (!four_characters.empty() && four_characters.back() == ' ') four_characters.remove_suffix(1);
  for (const LayoutInfo& info : kLayouts) {
    if (!four_characters.empty() && info.v4l2 == four_characters) return info.layout;
  }
  return std::nullopt;
}

cv::Mat ToGrey(std::span<const std::byte> bytes, PixelLayout layout, cv::Size size, std::size_t row_bytes) {
  if (size.width < 1 || size.height < 1) {
    throw std::invalid_argument(NameOf(layout) + ": a picture of " + Words(size) + " pixels");
  }
  if (layout == PixelLayout::kJpeg) return ReadJpeg(bytes, size);

  const std::size_t row = RowBytesOf(layout, size.width);
  if (row_bytes == 0) row_bytes = row;
  if (row_bytes < row) {
    throw std::invalid_argument(NameOf(layout) + ": rows of " + std::to_string(row_bytes) + " bytes, " +
                                std::to_string(size.width) + " pixels need " + std::to_string(row));
  }
  // The last row needs no padding behind it.
  const std::size_t needed = row_bytes * (static_cast<std::size_t>(size.height) - 1) + row;
  if (bytes.size() < needed) {
    throw std::invalid_argument(NameOf(layout) + ": " + std::to_string(bytes.size()) + " bytes, a picture of " +
                                Words(size) + " pixels needs " + std::to_string(needed));
  }
  const auto* const data = reinterpret_cast<const std::uint8_t*>(bytes.data());
  if (layout == PixelLayout::kMono8) return ReadNarrow(data, size, row_bytes, 1);
  if (layout == PixelLayout::kYuyv) return ReadNarrow(data, size, row_bytes, 2);
  return ReadWide(data, layout, size, row_bytes);
}

}  // namespace granary
