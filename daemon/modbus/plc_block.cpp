// A block is laid out once; from then on each push only fills in values.
#include "daemon/modbus/plc_block.h"

#include <algorithm>
#include <span>
#include <stdexcept>
#include <string_view>

#include <modbus/modbus.h>

namespace granary {
namespace {

constexpr int kAddresses = 65536;
constexpr int kSummaryWords = 65;
constexpr int kBookWords = 4;
constexpr std::string_view kSealingField = "sequence_check";

/// A value must not be split between two writes, so one that fills more than a write cannot be pushed.
bool CanBePushed(const RegisterRow& row) { return row.words <= MODBUS_MAX_WRITE_REGISTERS; }

const RegisterRow* FindField(const std::string& name) {
  const RegisterRow* row = FindRegister(name);
  return row != nullptr && CanBePushed(*row) ? row : nullptr;
}

std::vector<PlcWrite> SplitIntoWrites(const std::vector<PlcField>& fields, int words) {
  if (words <= MODBUS_MAX_WRITE_REGISTERS) return {{0, words}};
  std::vector<PlcWrite> writes{{0, 0}};
  int sealing = -1;
  for (const auto& field : fields) {
    const int end = field.offset + field.row->words;
    if (end - writes.back().offset > MODBUS_MAX_WRITE_REGISTERS) writes.push_back({field.offset, 0});
    writes.back().words = end - writes.back().offset;
    if (field.row->name == kSealingField) sealing = writes.back().offset;
  }
  std::stable_partition(writes.begin(), writes.end(), [&](const PlcWrite& write) { return write.offset != sealing; });
  return writes;
}

std::string Joined(const std::vector<std::string>& words) {
  std::string text;
  for (const auto& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

std::vector<std::string> FieldNames() {
  std::vector<std::string> names;
  for (const auto& row : RegisterTable()) {
    if (CanBePushed(row)) names.emplace_back(row.name);
  }
  return names;
}

}  // namespace

PlcBlock LayOutPlcBlock(const std::vector<std::string>& fields) {
  PlcBlock block;
  if (fields.empty()) {
    for (const auto& row : RegisterTable()) {
      if (row.address + row.words <= kSummaryWords) block.fields.push_back({&row, row.address});
    }
    block.words = kSummaryWords;
  }
  for (const auto& name : fields) {
    const RegisterRow* row = FindField(name);
    if (row == nullptr) throw std::invalid_argument("fields: \"" + name + "\" is no register that can be pushed");
    block.fields.push_back({row, block.words});
    block.words += row->words;
  }
  block.writes = SplitIntoWrites(block.fields, block.words);
  return block;
}

std::vector<std::uint16_t> EncodePlcBlock(const PlcBlock& block, const RegisterSource& source, ByteOrder order) {
  std::vector<std::uint16_t> words(static_cast<std::size_t>(block.words));
  const RegisterFormat format{order, source.snapshot.format.invalid};
  for (const auto& field : block.fields) {
    EncodeRow(*field.row, source, format,
              std::span(words).subspan(static_cast<std::size_t>(field.offset), field.row->words));
  }
  return words;
}

std::string NameInPlcBlock(const PlcBlock& block, int offset) {
  for (const auto& field : block.fields) {
    if (offset >= field.offset && offset < field.offset + field.row->words) return std::string(field.row->name);
  }
  return "reserved";
}

std::vector<std::string> PlcFaults(const ModbusPlcOptions& options, std::size_t bins) {
  std::vector<std::string> faults;
  // libmodbus sends no other unit ids.
  if (options.unit > 247 && options.unit < 255) {
    faults.push_back("unit: is " + std::to_string(options.unit) + "; must be 0 to 247, or 255");
  }
  const int count = static_cast<int>(bins);
  if (options.book_base && *options.book_base + kBookWords * count > kAddresses) {
    faults.push_back("book_base: " + std::to_string(count) + " bins take " + std::to_string(kBookWords * count) +
                     " registers from there; must be 0 to " + std::to_string(kAddresses - kBookWords * count));
  }

  std::vector<std::string> unknown;
  for (const auto& name : options.fields) {
    if (FindField(name) == nullptr) unknown.push_back('"' + name + '"');
  }
  if (!unknown.empty()) {
    faults.push_back("fields: no register is called " + Joined(unknown) + "; must be out of " + Joined(FieldNames()));
    return faults;  // where the blocks lie is not known
  }

  const int words = LayOutPlcBlock(options.fields).words;
  if (count > 1 && options.stride < words) {
    faults.push_back("stride: is " + std::to_string(options.stride) +
                     ", so that the blocks of two bins overlap; must be " + std::to_string(words) +
                     " or more, the length of a block");
  }
  const int span = std::max(0, count - 1) * options.stride + words;
  if (span > kAddresses) {
    faults.push_back("stride: is " + std::to_string(options.stride) + ", and " + std::to_string(count) +
                     " bins would take " + std::to_string(span) + " registers; must fit into 65536");
  } else if (options.base + span > kAddresses) {
    faults.push_back("base: " + std::to_string(count) + " bins take " + std::to_string(span) +
                     " registers from there; must be 0 to " + std::to_string(kAddresses - span));
  }
  for (int bin = 0; options.book_base && bin < count; ++bin) {
    const int block = options.base + bin * options.stride;
    if (*options.book_base >= block + words || *options.book_base + kBookWords * count <= block) continue;
    faults.push_back("book_base: what is read there would be what is written: the block of a bin takes registers " +
                     std::to_string(block) + " to " + std::to_string(block + words - 1) + "; must lie outside");
    break;
  }
  return faults;
}

}  // namespace granary
