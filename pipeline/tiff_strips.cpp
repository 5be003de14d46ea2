// Nobody tells a damaged strip from a good one by a checksum (but in Deflate), so every code and every length is
// checked against what is left to read and to fill.
#include "pipeline/tiff_strips.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>

namespace granary {
namespace {

/// Codes of a growing number of bits, highest bit first.
class Codes {
 public:
  explicit Codes(std::string_view bytes) : bytes_(bytes) {}
  /// -1 at the end of the bytes.
  [[nodiscard]] int Next(int bits) {
    while (filled_ < bits) {
      if (at_ == bytes_.size()) return -1;
      held_ = held_ << 8 | static_cast<std::uint8_t>(bytes_[at_++]);
      filled_ += 8;
    }
    filled_ -= bits;
    return static_cast<int>(held_ >> filled_ & ((1U << bits) - 1));
  }

 private:
  std::string_view bytes_;
  std::size_t at_ = 0;
  std::uint32_t held_ = 0;  // older bits fall out at the top
  int filled_ = 0;
};

}  // namespace

bool UnpackLzw(std::string_view packed, std::span<std::uint8_t> to) {
  constexpr int kClear = 256, kEnd = 257, kFirstFree = 258, kTableSize = 4096;
  // A code stands for a run of bytes that was already unpacked once: where it began and how long it is.
  struct Run {
    std::size_t at, size;
  };
  std::array<Run, kTableSize> runs;
  int next_free = kFirstFree, bits = 9;
  bool has_previous = false;
  Run previous{};
  std::size_t filled = 0;
  Codes codes(packed);
  // Strips of before 1988 have their bits the other way round; they do not begin with kClear either.
  if (codes.Next(bits) != kClear) return false;
  while (filled < to.size()) {
    const int code = codes.Next(bits);
    if (code < 0 || code == kEnd) return false;
    if (code == kClear) {
      next_free = kFirstFree;
      bits = 9;
      has_previous = false;
      continue;
    }
    // The previous run and the byte that follows it get the next code. That byte is the one written now, so that the
    // new run may be used at once, before it is complete.
    if (has_previous && next_free < kTableSize) runs[next_free++] = {previous.at, previous.size + 1};
    if (code >= next_free) return false;

    Run now{filled, 1};
    if (code < kClear) {
      to[filled] = static_cast<std::uint8_t>(code);
    } else {
      const Run run = runs[code];
      now.size = std::min(run.size, to.size() - filled);
      // Byte by byte: a run may reach into what it is copied to.
      for (std::size_t i = 0; i < now.size; ++i) to[filled + i] = to[run.at + i];
    }
    filled += now.size;
    previous = now;
    has_previous = true;
    // One code earlier than the table would need it: TIFF's own habit.
    if (next_free >= (1 << bits) - 1 && bits < 12) ++bits;
  }
  return true;
}

bool UnpackDeflate(std::string_view packed, std::span<std::uint8_t> to) {
  uLongf size = to.size();
  const int result =
      ::uncompress(to.data(), &size, reinterpret_cast<const Bytef*>(packed.data()), static_cast<uLong>(packed.size()));
  return result == Z_OK && size == to.size();
}

bool UnpackBytes(std::string_view packed, std::span<std::uint8_t> to) {
  std::size_t at = 0, filled = 0;
  while (filled < to.size()) {
    if (at == packed.size()) return false;
    const int count = static_cast<signed char>(packed[at++]);
    if (count == -128) continue;  // no operation
    const std::size_t size = static_cast<std::size_t>(count >= 0 ? count + 1 : 1 - count);
    const std::size_t taken = count >= 0 ? size : 1;
    if (taken > packed.size() - at || size > to.size() - filled) return false;
    if (count >= 0) {
      std::memcpy(to.data() + filled, packed.data() + at, size);
    } else {
      std::memset(to.data() + filled, static_cast<unsigned char>(packed[at]), size);
    }
    at += taken;
    filled += size;
  }
  return true;
}

}  // namespace granary
