// An RTU frame carries no mark and no length field of its own: only its function tells how long it is, by a fixed form
// or by a count inside. Lengths follow the Modbus Application Protocol V1.1b3, §6.
#include "daemon/modbus/rtu_frame.h"

#include <array>
#include <stdexcept>

#include "daemon/modbus/framing.h"

namespace granary {
namespace {

constexpr std::array<std::uint16_t, 256> MakeCrcTable() {
  std::array<std::uint16_t, 256> table{};
  for (unsigned byte = 0; byte < table.size(); ++byte) {
    unsigned crc = byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1U) != 0 ? (crc >> 1U) ^ 0xA001U : crc >> 1U;
    table[byte] = static_cast<std::uint16_t>(crc);
  }
  return table;
}
constexpr auto kCrcTable = MakeCrcTable();

constexpr std::size_t kCrcBytes = 2;

std::size_t AtMostAFrame(std::size_t bytes) { return bytes <= kMaxRtuBytes ? bytes : 0; }

/// A frame whose byte `index` counts the bytes after it.
std::size_t Counted(std::span<const std::uint8_t> frame, std::size_t index) {
  const std::size_t shortest = index + 1 + kCrcBytes;
  return frame.size() > index ? AtMostAFrame(shortest + frame[index]) : shortest;
}

/// A reply to FC24, whose count has two bytes.
std::size_t FifoReply(std::span<const std::uint8_t> frame) {
  if (frame.size() < 4) return 6;
  return AtMostAFrame(6 + ((std::size_t{frame[2]} << 8U) | frame[3]));
}

/// A reply to FC43/14: objects, each with a length of its own.
std::size_t IdentificationReply(std::span<const std::uint8_t> frame) {
  constexpr std::size_t kHeader = 8;  // address … number of objects
  if (frame.size() < kHeader) return kHeader + kCrcBytes;
  std::size_t end = kHeader;
  for (int object = 0; object < frame[kHeader - 1]; ++object) {
    if (frame.size() < end + 2) return AtMostAFrame(end + 2 + kCrcBytes);
    end += 2 + frame[end + 1];
  }
  return AtMostAFrame(end + kCrcBytes);
}

bool IsOtherThanIdentification(std::span<const std::uint8_t> frame) { return frame.size() > 2 && frame[2] != 14; }

}  // namespace

RtuTiming TimingOf(int baud) {
  using namespace std::chrono_literals;
  const std::chrono::nanoseconds character{11'000'000'000 / baud};
  if (baud > 19200) return {character, 750us, 1750us};
  return {character, character * 3 / 2, character * 7 / 2};
}

std::uint16_t Crc16(std::span<const std::uint8_t> bytes) {
  unsigned crc = 0xFFFF;
  for (const std::uint8_t byte : bytes) crc = (crc >> 8U) ^ kCrcTable[(crc ^ byte) & 0xFFU];
  return static_cast<std::uint16_t>(crc);
}

std::vector<std::uint8_t> RtuFrame(std::uint8_t address, std::span<const std::uint8_t> pdu) {
  if (pdu.empty() || pdu.size() > kMaxPduBytes) throw std::length_error("a Modbus PDU has 1 to 253 bytes");
  std::vector<std::uint8_t> frame;
  frame.reserve(1 + pdu.size() + kCrcBytes);
  frame.push_back(address);
  frame.insert(frame.end(), pdu.begin(), pdu.end());
  const std::uint16_t crc = Crc16(frame);
  frame.push_back(static_cast<std::uint8_t>(crc));
  frame.push_back(static_cast<std::uint8_t>(crc >> 8));
  return frame;
}

std::size_t RequestBytes(std::span<const std::uint8_t> frame) {
  if (frame.size() < 2) return kMinRtuBytes;
  switch (frame[1]) {
    case 1:
    case 2:
    case 3:
    case 4:
    case 5:
    case 6:
    case 8:
      return 8;
    case 7:
    case 11:
    case 12:
    case 17:
      return 4;
    case 15:
    case 16:
      return Counted(frame, 6);
    case 20:
    case 21:
      return Counted(frame, 2);
    case 22:
      return 10;
    case 23:
      return Counted(frame, 10);
    case 24:
      return 6;
    case 43:
      return IsOtherThanIdentification(frame) ? 0 : 7;
    default:
      return 0;
  }
}

std::size_t ReplyBytes(std::span<const std::uint8_t> frame) {
  if (frame.size() < 2) return kMinRtuBytes;
  if (frame[1] > 0x80) return 5;  // an exception
  switch (frame[1]) {
    case 1:
    case 2:
    case 3:
    case 4:
    case 12:
    case 17:
    case 20:
    case 21:
    case 23:
      return Counted(frame, 2);
    case 5:
    case 6:
    case 8:
    case 11:
    case 15:
    case 16:
      return 8;
    case 7:
      return 5;
    case 22:
      return 10;
    case 24:
      return FifoReply(frame);
    case 43:
      return IsOtherThanIdentification(frame) ? 0 : IdentificationReply(frame);
    default:
      return 0;
  }
}

}  // namespace granary
