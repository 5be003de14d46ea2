// Request PDU in, reply PDU out. Written out here and not left to libmodbus: its modbus_reply sleeps half a second
// before it answers a function it does not know or a bad quantity, sends on a socket of its own without waiting for
// room, reads past short PDUs (stephane/libmodbus#837), and knows neither FC43 nor an identity of ours.
// Exception codes follow the state diagrams of the Modbus Application Protocol V1.1b3, §6.
#include "daemon/modbus/answer.h"

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>

#include "daemon/modbus/framing.h"
#include "daemon/modbus/status.h"

namespace granary {
namespace {

constexpr std::uint8_t kMeiIdentification = 14;

constexpr int kMaxReadRegisters = 125;
constexpr int kMaxReadBits = 2000;

/// @param limit bits that there are
Pdu ReadBits(std::span<const std::uint8_t> request, std::uint64_t bits, int limit) {
  if (request.size() != 5) return ExceptionPdu(request[0], ModbusException::kIllegalValue);
  const int address = WordAt(request, 1), count = WordAt(request, 3);
  if (count < 1 || count > kMaxReadBits) return ExceptionPdu(request[0], ModbusException::kIllegalValue);
  if (address + count > limit) return ExceptionPdu(request[0], ModbusException::kIllegalAddress);
  const auto bytes = static_cast<std::uint8_t>((count + 7) / 8);
  Pdu reply(2 + std::size_t{bytes});
  reply[0] = request[0];
  reply[1] = bytes;
  for (int i = 0; i < count; ++i) {
    if ((bits >> (address + i)) & 1) reply[2 + i / 8] |= static_cast<std::uint8_t>(1 << (i % 8));
  }
  return reply;
}

Pdu ServerId(std::span<const std::uint8_t> request, const UnitView& unit) {
  const ModbusIdentity& identity = unit.identity;
  std::string text = identity.product + " " + identity.version + ", " + identity.site + ", " + unit.bin.name;
  text.resize(CutText(text, 200).size());
  constexpr std::uint8_t kRunning = 0xFF;
  Pdu reply;
  reply.reserve(4 + text.size());
  reply = {request[0], static_cast<std::uint8_t>(2 + text.size()), static_cast<std::uint8_t>(unit.bin.id), kRunning};
  reply.insert(reply.end(), text.begin(), text.end());
  return reply;
}

struct IdentityObject {
  std::uint8_t id;
  std::string_view text;
};

/// Basic objects are 0–2, regular ones up to 0x7F, extended ones from 0x80; FC43/14, §6.21.
Pdu Identification(std::span<const std::uint8_t> request, const UnitView& unit) {
  if (request.size() < 2 || request[1] != kMeiIdentification) {
    return ExceptionPdu(request[0], ModbusException::kIllegalFunction);
  }
  if (request.size() != 4) return ExceptionPdu(request[0], ModbusException::kIllegalValue);
  const std::uint8_t code = request[2], wanted = request[3];
  constexpr std::uint8_t kBasic = 1, kRegular = 2, kIndividual = 4;  // 3: extended
  if (code < kBasic || code > kIndividual) return ExceptionPdu(request[0], ModbusException::kIllegalValue);

  const ModbusIdentity& identity = unit.identity;
  const IdentityObject objects[] = {{0x00, identity.vendor},  {0x01, identity.product},
                                    {0x02, identity.version}, {0x04, "Granary volume monitor"},
                                    {0x80, identity.site},    {0x81, unit.bin.name}};
  const int last_id = code == kBasic ? 0x02 : code == kRegular ? 0x7F : 0xFF;
  auto first = std::find_if(std::begin(objects), std::end(objects), [&](const auto& o) { return o.id == wanted; });
  if (code == kIndividual) {
    if (first == std::end(objects)) return ExceptionPdu(request[0], ModbusException::kIllegalAddress);
  } else if (first == std::end(objects) || first->id > last_id) {
    first = std::begin(objects);  // as the specification wants it for an object that is not there
  }

  constexpr std::uint8_t kConformity = 0x83;  // extended, stream and individual access
  Pdu reply{request[0], kMeiIdentification, code, kConformity, 0, 0, 0};
  std::uint8_t more = 0, next = 0, count = 0;
  for (auto object = first; object != std::end(objects) && object->id <= last_id; ++object) {
    // A name of any length fits one object by being cut; what does not fit this reply is asked for with the next.
    const auto text = CutText(object->text, 120);
    if (reply.size() + 2 + text.size() > kMaxPduBytes) {
      more = 0xFF;
      next = object->id;
      break;
    }
    reply.push_back(object->id);
    reply.push_back(static_cast<std::uint8_t>(text.size()));
    reply.insert(reply.end(), text.begin(), text.end());
    ++count;
    if (code == kIndividual) break;
  }
  reply[4] = more;
  reply[5] = next;
  reply[6] = count;
  return reply;
}

}  // namespace

Pdu ExceptionPdu(std::uint8_t function, ModbusException code) {
  return {static_cast<std::uint8_t>(function | 0x80), static_cast<std::uint8_t>(code)};
}

Pdu ReadRegisters(std::span<const std::uint8_t> request, const RegisterImage& registers) {
  if (request.size() != 5) return ExceptionPdu(request[0], ModbusException::kIllegalValue);
  const int address = WordAt(request, 1), count = WordAt(request, 3);
  if (count < 1 || count > kMaxReadRegisters) return ExceptionPdu(request[0], ModbusException::kIllegalValue);
  if (address + count > kRegisterCount) return ExceptionPdu(request[0], ModbusException::kIllegalAddress);
  Pdu reply(2 + 2 * static_cast<std::size_t>(count));
  reply[0] = request[0];
  reply[1] = static_cast<std::uint8_t>(2 * count);
  for (int i = 0; i < count; ++i) {
    reply[2 + 2 * i] = static_cast<std::uint8_t>(registers[address + i] >> 8);
    reply[3 + 2 * i] = static_cast<std::uint8_t>(registers[address + i]);
  }
  return reply;
}

Pdu AnswerRequest(std::span<const std::uint8_t> request, const UnitView& unit) {
  switch (request[0]) {
    case function_code::kReadCoils:
      return ReadBits(request, unit.coils, kCoilCount);
    case function_code::kReadDiscreteInputs:
      return ReadBits(request, unit.coils, kDiscreteInputCount);
    case function_code::kReadHoldingRegisters:
    case function_code::kReadInputRegisters:
      return ReadRegisters(request, unit.registers);
    case function_code::kReportServerId:
      return ServerId(request, unit);
    case function_code::kEncapsulated:
      return Identification(request, unit);
    default:
      return ExceptionPdu(request[0], ModbusException::kIllegalFunction);
  }
}

}  // namespace granary
