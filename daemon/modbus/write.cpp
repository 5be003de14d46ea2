// A write is read into one plain value first, so that a request which is wrong anywhere changes nothing. Registers that
// can be written lie in three groups with gaps between them: one request can reach into one group only.
#include "daemon/modbus/write.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <vector>

#include "daemon/modbus/status.h"

namespace granary {
namespace {

constexpr int kByteOrderAddress = 900, kInvalidPolicyAddress = 901;
constexpr int kCommandAddress = 910;
constexpr int kBookAddress = 920, kCommitAddress = 930;

constexpr int kMaxWriteRegisters = 123, kMaxReadWriteRegisters = 121, kMaxWriteCoils = 1968;

WritePlan PlanFormat(int address, std::span<const std::uint16_t> words, RegisterFormat format) {
  for (const std::uint16_t word : words) {
    if (address == kByteOrderAddress) {
      if (word > static_cast<std::uint16_t>(ByteOrder::kBadc)) return ModbusException::kIllegalValue;
      format.byte_order = static_cast<ByteOrder>(word);
    } else {
      if (word > static_cast<std::uint16_t>(InvalidPolicy::kMinus9999)) return ModbusException::kIllegalValue;
      format.invalid = static_cast<InvalidPolicy>(word);
    }
    ++address;
  }
  return format;
}

WritePlan PlanCommand(std::uint16_t word) {
  if (word > static_cast<std::uint16_t>(BinCommand::kRelease)) return ModbusException::kIllegalValue;
  return static_cast<BinCommand>(word);
}

WritePlan PlanBook(int address, std::span<const std::uint16_t> words, const BookState& book) {
  if (!book.writable) return ModbusException::kIllegalAddress;
  BookWrite write;
  for (const std::uint16_t word : words) {
    const auto index = static_cast<std::size_t>(address++ - kBookAddress);
    if (index < write.words.size()) {
      write.words[index] = word;
    } else if (index == kCommitAddress - kBookAddress) {
      if (word != 1) return ModbusException::kIllegalValue;
      write.commit = true;
    } else if (word != 0) {
      return ModbusException::kIllegalValue;  // reserved
    }
  }
  return write;
}

WritePlan PlanRegisters(int address, std::span<const std::uint16_t> words, const BinSnapshot& snapshot) {
  const int last = address + static_cast<int>(words.size()) - 1;
  if (address >= kByteOrderAddress && last <= kInvalidPolicyAddress) {
    return PlanFormat(address, words, snapshot.format);
  }
  if (address == kCommandAddress && last == address) return PlanCommand(words[0]);
  if (address >= kBookAddress && last <= kCommitAddress) return PlanBook(address, words, snapshot.book);
  return ModbusException::kIllegalAddress;
}

/// @param data quantity, byte count and values of FC16 and FC23
WritePlan PlanManyRegisters(int address, std::span<const std::uint8_t> data, int limit, const BinSnapshot& snapshot) {
  if (data.size() < 3) return ModbusException::kIllegalValue;
  const std::size_t count = WordAt(data, 0), bytes = data[2];
  if (count < 1 || count > static_cast<std::size_t>(limit) || bytes != 2 * count || data.size() != 3 + bytes) {
    return ModbusException::kIllegalValue;
  }
  std::vector<std::uint16_t> words;
  for (std::size_t i = 0; i < count; ++i) words.push_back(WordAt(data, 3 + 2 * i));
  return PlanRegisters(address, words, snapshot);
}

/// Whoever writes all coils at once means the state of inhibit, not a change of it; a lone one is a command even then.
WritePlan PlanCoils(int address, const std::vector<bool>& coils, const BinSnapshot& snapshot) {
  const int end = address + static_cast<int>(coils.size());
  if (address < kMeasureCoil || end > kCoilCount) return ModbusException::kIllegalAddress;
  std::vector<BinCommand> commands;
  for (const bool on : coils) {
    const int coil = address++;
    if (coil == kMeasureCoil && on) commands.push_back(BinCommand::kMeasure);
    if (coil == kAcknowledgeCoil && on) commands.push_back(BinCommand::kAcknowledge);
    if (coil == kInhibitCoil && (coils.size() == 1 || on != snapshot.maintenance)) {
      commands.push_back(on ? BinCommand::kInhibit : BinCommand::kRelease);
    }
  }
  if (commands.empty()) return std::monostate{};
  if (commands.size() > 1) return ModbusException::kIllegalValue;  // there is one handshake
  return commands.front();
}

/// @param data quantity, byte count and bits of FC15
WritePlan PlanManyCoils(int address, std::span<const std::uint8_t> data, const BinSnapshot& snapshot) {
  if (data.size() < 3) return ModbusException::kIllegalValue;
  const std::size_t count = WordAt(data, 0), bytes = data[2];
  if (count < 1 || count > kMaxWriteCoils || bytes != (count + 7) / 8 || data.size() != 3 + bytes) {
    return ModbusException::kIllegalValue;
  }
  std::vector<bool> coils;
  for (std::size_t i = 0; i < count; ++i) coils.push_back(((data[3 + i / 8] >> (i % 8)) & 1) != 0);
  return PlanCoils(address, coils, snapshot);
}

WritePlan PlanCoil(int address, std::uint16_t value, const BinSnapshot& snapshot) {
  constexpr std::uint16_t kOn = 0xFF00, kOff = 0;
  if (value != kOn && value != kOff) return ModbusException::kIllegalValue;
  return PlanCoils(address, {value == kOn}, snapshot);
}

}  // namespace

bool IsWrite(std::uint8_t function) {
  constexpr std::array kWrites{function_code::kWriteCoil,         function_code::kWriteRegister,
                               function_code::kWriteCoils,        function_code::kWriteRegisters,
                               function_code::kMaskWriteRegister, function_code::kReadWriteRegisters};
  return std::find(kWrites.begin(), kWrites.end(), function) != kWrites.end();
}

WritePlan PlanWrite(std::span<const std::uint8_t> request, const BinSnapshot& snapshot,
                    const RegisterImage& registers) {
  const std::size_t least = request[0] == function_code::kReadWriteRegisters  ? 10
                            : request[0] == function_code::kMaskWriteRegister ? 7
                                                                              : 5;
  if (request.size() < least) return ModbusException::kIllegalValue;
  const int address = WordAt(request, request[0] == function_code::kReadWriteRegisters ? 5 : 1);
  switch (request[0]) {
    case function_code::kWriteCoils:
      return PlanManyCoils(address, request.subspan(3), snapshot);
    case function_code::kWriteRegisters:
      return PlanManyRegisters(address, request.subspan(3), kMaxWriteRegisters, snapshot);
    case function_code::kReadWriteRegisters:
      return PlanManyRegisters(address, request.subspan(7), kMaxReadWriteRegisters, snapshot);
    default:
      break;
  }
  if (request.size() != least) return ModbusException::kIllegalValue;
  const std::uint16_t first = WordAt(request, 3);
  if (request[0] == function_code::kWriteCoil) return PlanCoil(address, first, snapshot);
  if (request[0] == function_code::kWriteRegister) return PlanRegisters(address, std::array{first}, snapshot);
  if (address >= kRegisterCount) return ModbusException::kIllegalAddress;
  const std::uint16_t second = WordAt(request, 5);
  const auto masked = static_cast<std::uint16_t>((registers[address] & first) | (second & ~first));
  return PlanRegisters(address, std::array{masked}, snapshot);
}

BookData BookOf(const BookWords& words, const Inventory& in_force) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  constexpr double kKgPerTonne = 1000;
  const auto figure = [&](std::size_t high, double unchanged, double factor) {
    const auto &first = words[high], &second = words[high + 1];
    if (!first && !second) return unchanged;
    if (!first || !second) return kUnknown;
    const float written = std::bit_cast<float>((std::uint32_t{*first} << 16) | *second);
    return factor * double{written};
  };
  return {.book_mass_kg = figure(0, in_force.book_mass_kg.value_or(kUnknown), kKgPerTonne),
          .density_kg_m3 = figure(2, in_force.density_kg_m3.value_or(kUnknown), 1),
          .correction = figure(4, in_force.correction, 1),
          .loss_kg = figure(6, in_force.loss_kg, kKgPerTonne)};
}

void ShowStage(const BookStage& stage, RegisterImage& registers) {
  for (std::size_t i = 0; i < stage.words.size(); ++i) {
    if (stage.words[i]) registers[kBookAddress + i] = *stage.words[i];
  }
  registers[kCommitAddress] = static_cast<std::uint16_t>(CommandResult::kBusy);
}

std::string_view HostOf(std::string_view name) {
  const std::size_t colon = name.rfind(':');
  if (name.starts_with('/') || colon == std::string_view::npos) return name;
  const std::string_view port = name.substr(colon + 1);
  const bool is_port = !port.empty() && port.find_first_not_of("0123456789") == std::string_view::npos;
  return is_port ? name.substr(0, colon) : name;
}

}  // namespace granary
