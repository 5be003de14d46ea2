// The MBAP header (Modbus Messaging on TCP/IP, V1.0b, §3.1.3) is the only mark in the stream: it is judged byte by
// byte, so that rubbish is known for what it is before it can keep anybody waiting.
#include "daemon/modbus/framing.h"

#include <stdexcept>

namespace granary {
namespace {

void AppendWord(std::uint16_t word, std::vector<std::uint8_t>& bytes) {
  bytes.push_back(static_cast<std::uint8_t>(word >> 8));
  bytes.push_back(static_cast<std::uint8_t>(word));
}

ModbusFrame Malformed(std::string_view fault) {
  ModbusFrame frame;
  frame.state = FrameState::kMalformed;
  frame.fault = fault;
  return frame;
}

}  // namespace

ModbusFrame ParseFrame(std::span<const std::uint8_t> stream) {
  if (stream.size() >= 3 && stream[2] != 0) return Malformed("protocol id is not 0");
  if (stream.size() >= 4 && stream[3] != 0) return Malformed("protocol id is not 0");
  if (stream.size() < 6) return {};
  const std::size_t length = WordAt(stream, 4);  // of unit and PDU
  if (length < 2) return Malformed("length leaves no room for a function code");
  if (length > kMaxPduBytes + 1) return Malformed("length is more than 254");
  if (stream.size() < 6 + length) return {};
  return {.state = FrameState::kComplete,
          .fault = {},
          .bytes = 6 + length,
          .transaction = WordAt(stream, 0),
          .unit = stream[6],
          .pdu = stream.subspan(kMbapBytes, length - 1)};
}

void AppendFrame(std::uint16_t transaction, std::uint8_t unit, std::span<const std::uint8_t> pdu,
                 std::vector<std::uint8_t>& stream) {
  if (pdu.empty() || pdu.size() > kMaxPduBytes) throw std::length_error("a Modbus PDU has 1 to 253 bytes");
  AppendWord(transaction, stream);
  AppendWord(0, stream);
  AppendWord(static_cast<std::uint16_t>(pdu.size() + 1), stream);
  stream.push_back(unit);
  stream.insert(stream.end(), pdu.begin(), pdu.end());
}

}  // namespace granary
