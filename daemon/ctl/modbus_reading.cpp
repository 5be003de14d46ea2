// The table that the server encodes from is read backwards here, over bytes that libmodbus fetched: what comes out is
// what a SCADA system sees that was set up from the manual.
#include "daemon/ctl/modbus_reading.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <iterator>
#include <stdexcept>
#include <string>

#include "daemon/modbus/status.h"
#include "daemon/modbus/word_order.h"

namespace granary {
namespace {

constexpr RegisterBlock kBlocks[] = {{"summary", 0, 99},     {"5708", 100, 199},     {"diagnostics", 200, 299},
                                     {"identity", 300, 349}, {"settings", 900, 999}, {"integers", 3000, 3999}};
constexpr int kByteOrderAddress = 900;  ///< followed by the invalid policy
constexpr double kInvalidFigure = -9999;

/// 1.4276 instead of 1.4275999069213867: more digits than a float has would claim more than was sent.
double ShortestDecimal(float value) {
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
  double shortest = value;
  std::from_chars(text.data(), end, shortest);
  return shortest;
}

/// A time or a wait that is not known is all ones; a counter may come to that number.
bool IsUnknownTime(const RegisterRow& row, std::uint32_t value) {
  return row.unit == "s" && value == (row.type == RegisterType::kU16 ? kUnknownU16 : kUnknownU32);
}

ReadValue DecodeText(std::span<const std::uint16_t> words) {
  std::string text;
  for (const std::uint16_t word : words) {
    text += static_cast<char>(word >> 8);
    text += static_cast<char>(word & 0xFF);
  }
  text.resize(std::min(text.find('\0'), text.size()));
  return text;
}

RegisterFormat ReadFormat(ModbusClient& client) {
  const auto words = client.Read(kByteOrderAddress, 2);
  if (words[0] > static_cast<int>(ByteOrder::kBadc) || words[1] > static_cast<int>(InvalidPolicy::kMinus9999)) {
    throw ModbusClientError("registers 900 and 901 read " + std::to_string(words[0]) + " and " +
                            std::to_string(words[1]) + "; is this a granaryd? 0 to 3 and 0 to 2 are known");
  }
  return {static_cast<ByteOrder>(words[0]), static_cast<InvalidPolicy>(words[1])};
}

void ReadBlock(ModbusClient& client, const RegisterBlock& block, Reading& reading) {
  const auto table = RegisterTable();
  const auto address_below = [](const RegisterRow& row, int address) { return row.address < address; };
  const auto begin = std::lower_bound(table.begin(), table.end(), block.first, address_below);
  const auto end = std::lower_bound(begin, table.end(), block.last + 1, address_below);
  const int first = begin->address, count = std::prev(end)->address + std::prev(end)->words - first;
  const auto words = client.Read(first, count);
  for (auto row = begin; row != end; ++row) {
    const auto offset = static_cast<std::size_t>(row->address - first);
    reading.rows.push_back({&*row, Decode(*row, std::span(words).subspan(offset, row->words), reading.format)});
  }
}

}  // namespace

std::span<const RegisterBlock> RegisterBlocks() { return kBlocks; }

std::vector<RegisterBlock> BlocksNamed(std::string_view name) {
  std::vector<RegisterBlock> blocks;
  std::copy_if(std::begin(kBlocks), std::end(kBlocks), std::back_inserter(blocks),
               [&](const RegisterBlock& block) { return name == "all" || name == block.name; });
  return blocks;
}

ReadValue Decode(const RegisterRow& row, std::span<const std::uint16_t> words, const RegisterFormat& format) {
  const ByteOrder order = row.address < kFormattedRegisters ? format.byte_order : ByteOrder::kAbcd;
  const bool marked = format.invalid == InvalidPolicy::kMinus9999;
  switch (row.type) {
    case RegisterType::kU16:
      if (IsUnknownTime(row, words[0])) return {};
      return std::int64_t{words[0]};
    case RegisterType::kU32: {
      const std::uint32_t value = Take32(words, order);
      if (IsUnknownTime(row, value)) return {};
      return std::int64_t{value};
    }
    case RegisterType::kI32: {
      const auto value = static_cast<std::int32_t>(Take32(words, order));
      if (value == kUnknownI32 || (row.figure && marked && value == kInvalidFigure)) return {};
      return std::int64_t{value};
    }
    case RegisterType::kF32: {
      const auto value = std::bit_cast<float>(Take32(words, order));
      if (!std::isfinite(value) || (row.figure && marked && value == kInvalidFigure)) return {};
      return ShortestDecimal(value);
    }
    case RegisterType::kAscii:
      return DecodeText(words);
    case RegisterType::kMirror:
      break;
  }
  throw std::logic_error("a mirror has no value of its own");
}

const ReadValue& Reading::Of(std::string_view name) const {
  const auto found = std::find_if(rows.begin(), rows.end(), [&](const Row& row) { return row.row->name == name; });
  if (found == rows.end()) throw std::out_of_range("register " + std::string(name) + " was not read");
  return found->value;
}

Reading ReadBlocks(ModbusClient& client, std::span<const RegisterBlock> blocks) {
  // Another client may change the byte order between two requests.
  RegisterFormat format = ReadFormat(client);
  for (int attempt = 0; attempt < 3; ++attempt) {
    Reading reading{format, {}};
    for (const RegisterBlock& block : blocks) ReadBlock(client, block, reading);
    format = ReadFormat(client);
    if (format == reading.format) return reading;
  }
  throw ModbusClientError("somebody keeps changing the byte order (registers 900 and 901) while it is read");
}

std::vector<std::string> StatusNames(std::int64_t status) {
  std::vector<std::string> names;
  for (const BitInfo& bit : StatusBitTable()) {
    if ((status >> bit.bit) & 1) names.emplace_back(bit.name);
  }
  return names;
}

std::string TextOf(const ReadValue& value) {
  if (const auto* integer = std::get_if<std::int64_t>(&value)) return std::to_string(*integer);
  if (const auto* text = std::get_if<std::string>(&value)) return *text;
  if (const auto* number = std::get_if<double>(&value)) {
    std::array<char, 32> digits{};
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), *number).ptr;
    return {digits.data(), end};
  }
  return "-";
}

}  // namespace granary
