// From values to words. Encoding walks the rows of the table; what no row claims stays 0.
#include "daemon/modbus/registers.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "daemon/modbus/status.h"
#include "daemon/modbus/word_order.h"

namespace granary {
namespace {

constexpr double kNotCurrent = -9999;

/// What `format` shows of a figure. @param value NaN unknown
double Shown(double value, const RegisterRow& row, const BinSnapshot& snapshot, InvalidPolicy policy) {
  if (!row.figure) return value;
  const bool current = IsCurrent(snapshot);
  switch (policy) {
    case InvalidPolicy::kHold:
      return value;
    case InvalidPolicy::kNan:
      return current ? value : std::numeric_limits<double>::quiet_NaN();
    case InvalidPolicy::kMinus9999:
      return current && !std::isnan(value) ? value : kNotCurrent;
  }
  throw std::logic_error("invalid policy is not in the list");
}

/// Out of range is unknown: a number that wrapped round would be believed.
std::uint32_t Scaled(double value) {
  const double rounded = std::round(value);
  const bool fits = rounded > kUnknownI32 && rounded <= std::numeric_limits<std::int32_t>::max();
  return std::bit_cast<std::uint32_t>(fits ? static_cast<std::int32_t>(rounded) : kUnknownI32);
}

void PutText(std::string_view text, std::span<std::uint16_t> words) {
  std::fill(words.begin(), words.end(), std::uint16_t{0});
  const std::string_view shown = CutText(text, 2 * words.size());
  for (std::size_t i = 0; i < shown.size(); ++i) {
    const auto byte = static_cast<unsigned char>(shown[i]);
    words[i / 2] = static_cast<std::uint16_t>(words[i / 2] | (i % 2 == 0 ? byte << 8 : byte));
  }
}

void PutMirror(const RegisterSource& source, const RegisterFormat& format, std::span<std::uint16_t> words) {
  std::fill(words.begin(), words.end(), std::uint16_t{0});
  for (const auto& row : RegisterTable()) {
    if (row.address >= kMirroredRegisters) break;
    EncodeRow(row, source, format, words.subspan(row.address, row.words));
  }
}

}  // namespace

std::string_view NameOf(RegisterType type) {
  switch (type) {
    case RegisterType::kU16:
      return "u16";
    case RegisterType::kU32:
      return "u32";
    case RegisterType::kI32:
      return "i32";
    case RegisterType::kF32:
      return "f32";
    case RegisterType::kAscii:
      return "ascii";
    case RegisterType::kMirror:
      return "mirror";
  }
  throw std::logic_error("register type is not in the list");
}

const RegisterRow* FindRegister(std::string_view name) {
  const auto table = RegisterTable();
  const auto found = std::find_if(table.begin(), table.end(), [&](const RegisterRow& row) { return row.name == name; });
  return found == table.end() ? nullptr : &*found;
}

void EncodeRow(const RegisterRow& row, const RegisterSource& source, const RegisterFormat& format,
               std::span<std::uint16_t> words) {
  if (words.size() != row.words) throw std::invalid_argument("register row needs as many words as it takes");
  const RegisterValue value = row.value(source);
  const auto shown = [&] { return Shown(std::get<double>(value), row, source.snapshot, format.invalid); };
  switch (row.type) {
    case RegisterType::kU16:
      words[0] = static_cast<std::uint16_t>(std::get<std::uint32_t>(value));
      break;
    case RegisterType::kU32:
      Put32(std::get<std::uint32_t>(value), format.byte_order, words);
      break;
    case RegisterType::kI32:
      Put32(Scaled(shown()), format.byte_order, words);
      break;
    case RegisterType::kF32:
      // Not modbus_set_float_abcd: what it calls ABCD changed between the library's releases, and in Debian 12's
      // 3.1.6 its setter and getter disagree.
      Put32(std::bit_cast<std::uint32_t>(static_cast<float>(shown())), format.byte_order, words);
      break;
    case RegisterType::kAscii:
      PutText(std::get<std::string>(value), words);
      break;
    case RegisterType::kMirror:
      PutMirror(source, {static_cast<ByteOrder>(std::get<std::uint32_t>(value)), format.invalid}, words);
      break;
  }
}

RegisterImage EncodeRegisters(const RegisterSource& source) {
  RegisterImage image{};
  EncodeRows(0, kRegisterCount, source, image);
  return image;
}

void EncodeRows(int first, int last, const RegisterSource& source, RegisterImage& image) {
  const RegisterFormat& chosen = source.snapshot.format;
  for (const auto& row : RegisterTable()) {
    if (row.address < first || row.address >= last) continue;
    const auto order = row.address < kFormattedRegisters ? chosen.byte_order : ByteOrder::kAbcd;
    EncodeRow(row, source, {order, chosen.invalid}, std::span(image).subspan(row.address, row.words));
  }
}

std::string_view CutText(std::string_view text, std::size_t bytes) {
  if (text.size() <= bytes) return text;
  while (bytes > 0 && (static_cast<unsigned char>(text[bytes]) & 0xC0) == 0x80) --bytes;
  return text.substr(0, bytes);
}

}  // namespace granary
