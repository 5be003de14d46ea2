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

constexpr std::uint8_t kReadDiscreteInputs = 2;
constexpr std::uint8_t kReadHoldingRegisters = 3;
constexpr std::uint8_t kReadInputRegisters = 4;
constexpr std::uint8_t kReportServerId = 17;
constexpr std::uint8_t kEncapsulated = 43;
constexpr std::uint8_t kMeiIdentification = 14;

constexpr int kMaxReadRegisters = 125;
constexpr int kMaxReadBits = 2000;

int WordAt(std::span<const std::uint8_t> bytes, std::size_t index) { return (bytes[index] << 8) | bytes[index + 1]; }

struct Block {
  int address, count;
};

Block BlockOf(std::span<const std::uint8_t> request) { return {WordAt(request, 1), WordAt(request, 3)}; }

Pdu ReadRegisters(std::span<const std::uint8_t> request, const RegisterSource& source) {
  if (request.size() != 5) return ExceptionPdu(request[0], ModbusException::kIllegalValue);
  const Block block = BlockOf(request);
  if (block.count < 1 || block.count > kMaxReadRegisters) {
    return ExceptionPdu(request[0], ModbusException::kIllegalValue);
  }
  if (block.address + block.count > kRegisterCount) return ExceptionPdu(request[0], ModbusException::kIllegalAddress);
  const RegisterImage image = EncodeRegisters(source);
  Pdu reply{request[0], static_cast<std::uint8_t>(2 * block.count)};
  for (int i = 0; i < block.count; ++i) {
    const std::uint16_t word = image[block.address + i];
    reply.push_back(static_cast<std::uint8_t>(word >> 8));
    reply.push_back(static_cast<std::uint8_t>(word));
  }
  return reply;
}

Pdu ReadBits(std::span<const std::uint8_t> request, const RegisterSource& source) {
  if (request.size() != 5) return ExceptionPdu(request[0], ModbusException::kIllegalValue);
  const Block block = BlockOf(request);
  if (block.count < 1 || block.count > kMaxReadBits) return ExceptionPdu(request[0], ModbusException::kIllegalValue);
  if (block.address + block.count > kDiscreteInputCount) {
    return ExceptionPdu(request[0], ModbusException::kIllegalAddress);
  }
  const std::uint64_t bits = CoilBits(source.snapshot);
  const auto bytes = static_cast<std::uint8_t>((block.count + 7) / 8);
  Pdu reply{request[0], bytes};
  reply.resize(2 + bytes, 0);
  for (int i = 0; i < block.count; ++i) {
    if ((bits >> (block.address + i)) & 1) reply[2 + i / 8] |= static_cast<std::uint8_t>(1 << (i % 8));
  }
  return reply;
}

Pdu ServerId(std::span<const std::uint8_t> request, const RegisterSource& source) {
  const ModbusIdentity& identity = source.identity;
  std::string text = identity.product + " " + identity.version + ", " + identity.site + ", " + source.snapshot.bin.name;
  text.resize(CutText(text, 200).size());
  constexpr std::uint8_t kRunning = 0xFF;
  Pdu reply;
  reply.reserve(4 + text.size());
  reply = {request[0], static_cast<std::uint8_t>(2 + text.size()), static_cast<std::uint8_t>(source.snapshot.bin.id),
           kRunning};
  reply.insert(reply.end(), text.begin(), text.end());
  return reply;
}

struct IdentityObject {
  std::uint8_t id;
  std::string_view text;
};

/// Basic objects are 0–2, regular ones up to 0x7F, extended ones from 0x80; FC43/14, §6.21.
Pdu Identification(std::span<const std::uint8_t> request, const RegisterSource& source) {
  if (request.size() < 2 || request[1] != kMeiIdentification) {
    return ExceptionPdu(request[0], ModbusException::kIllegalFunction);
  }
  if (request.size() != 4) return ExceptionPdu(request[0], ModbusException::kIllegalValue);
  const std::uint8_t code = request[2], wanted = request[3];
  constexpr std::uint8_t kBasic = 1, kRegular = 2, kIndividual = 4;  // 3: extended
  if (code < kBasic || code > kIndividual) return ExceptionPdu(request[0], ModbusException::kIllegalValue);

  const ModbusIdentity& identity = source.identity;
  const IdentityObject objects[] = {{0x00, identity.vendor},  {0x01, identity.product},
                                    {0x02, identity.version}, {0x04, "Granary volume monitor"},
                                    {0x80, identity.site},    {0x81, source.snapshot.bin.name}};
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

Pdu AnswerRequest(std::span<const std::uint8_t> request, const RegisterSource& source) {
  switch (request[0]) {
    case kReadDiscreteInputs:
      return ReadBits(request, source);
    case kReadHoldingRegisters:
    case kReadInputRegisters:
      return ReadRegisters(request, source);
    case kReportServerId:
      return ServerId(request, source);
    case kEncapsulated:
      return Identification(request, source);
    default:
      return ExceptionPdu(request[0], ModbusException::kIllegalFunction);
  }
}

}  // namespace granary
