// A client that writes nothing may get: a reply of the length it asked for, one certain exception, or, after a header
// that cannot begin a frame, the end of the connection.
#include "tests/bench/modbus_malformed.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <sys/socket.h>

#include "tests/bench/modbus_load.h"

namespace granary::bench {
namespace {

constexpr int kUnit = 3;
constexpr int kRegisters = 4000, kDiscreteInputs = 48, kCoils = 51;

int WordAt(const Bytes& bytes, std::size_t index) { return (bytes[index] << 8) | bytes[index + 1]; }

/// What must answer a request: an exception code, or the number of bytes of a normal reply's PDU.
struct Expected {
  int exception = 0;
  std::size_t bytes = 0;  ///< 0: of any length
};

Expected ExpectRead(const Bytes& pdu, int max_count, int end, bool bits) {
  if (pdu.size() != 5 || WordAt(pdu, 3) < 1 || WordAt(pdu, 3) > max_count) return {.exception = 3};
  const int count = WordAt(pdu, 3);
  if (WordAt(pdu, 1) + count > end) return {.exception = 2};
  return {.bytes = 2 + static_cast<std::size_t>(bits ? (count + 7) / 8 : 2 * count)};
}

Expected ExpectIdentification(const Bytes& pdu) {
  if (pdu.size() < 2 || pdu[1] != 14) return {.exception = 1};
  if (pdu.size() != 4 || pdu[2] < 1 || pdu[2] > 4) return {.exception = 3};
  constexpr std::array<std::uint8_t, 6> kObjects{0, 1, 2, 4, 0x80, 0x81};
  if (pdu[2] == 4 && std::find(kObjects.begin(), kObjects.end(), pdu[3]) == kObjects.end()) return {.exception = 2};
  return {};
}

Expected Expect(int unit, const Bytes& pdu) {
  constexpr std::array<std::uint8_t, 6> kWrites{5, 6, 15, 16, 22, 23};
  // Before the unit: who may not write learns nothing.
  if (std::find(kWrites.begin(), kWrites.end(), pdu[0]) != kWrites.end()) return {.exception = 1};
  if (unit != 0 && unit != 255 && unit != kUnit) return {.exception = 0x0B};
  switch (pdu[0]) {
    case 1:
      return ExpectRead(pdu, 2000, kCoils, true);
    case 2:
      return ExpectRead(pdu, 2000, kDiscreteInputs, true);
    case 3:
    case 4:
      return ExpectRead(pdu, 125, kRegisters, false);
    case 17:
      return {};
    case 43:
      return ExpectIdentification(pdu);
    default:
      return {.exception = 1};
  }
}

bool Answers(const Bytes& request, const Bytes& reply, const Expected& expected) {
  if (expected.exception != 0) {
    return reply.size() == 2 && reply[0] == (request[0] | 0x80) && reply[1] == expected.exception;
  }
  if (reply[0] != request[0]) return false;
  return expected.bytes == 0 || (reply.size() == expected.bytes && reply[1] == reply.size() - 2);
}

class Generator {
 public:
  explicit Generator(std::uint32_t seed) : random_(seed) {}

  int Below(int end) { return static_cast<int>(random_() % static_cast<std::uint32_t>(end)); }
  std::uint8_t Byte() { return static_cast<std::uint8_t>(random_()); }

  /// Unit and PDU: a good request with some of it changed, or any bytes at all.
  std::pair<int, Bytes> Request() {
    constexpr std::array<int, 13> kFunctions{1, 2, 3, 4, 5, 6, 15, 16, 17, 22, 23, 43, 20};
    Bytes pdu{static_cast<std::uint8_t>(kFunctions[static_cast<std::size_t>(Below(kFunctions.size()))])};
    if (pdu[0] == 43) {
      pdu.insert(pdu.end(), {14, static_cast<std::uint8_t>(1 + Below(4)), 0});
    } else if (pdu[0] != 17) {
      const int address = Below(kRegisters), count = 1 + Below(125);
      for (const int word : {address, count}) {
        pdu.push_back(static_cast<std::uint8_t>(word >> 8));
        pdu.push_back(static_cast<std::uint8_t>(word));
      }
    }
    switch (Below(6)) {
      case 0:
        pdu[static_cast<std::size_t>(Below(static_cast<int>(pdu.size())))] = Byte();
        break;
      case 1:
        pdu.resize(static_cast<std::size_t>(1 + Below(static_cast<int>(pdu.size()))));
        break;
      case 2:
        for (int more = 1 + Below(20); more > 0; --more) pdu.push_back(Byte());
        break;
      case 3:  // quantity
        if (pdu.size() == 5) pdu[3] = Byte(), pdu[4] = 0;
        break;
      case 4:  // address
        if (pdu.size() == 5) pdu[1] = static_cast<std::uint8_t>(0x0F + Below(0xF1)), pdu[2] = Byte();
        break;
      default:
        pdu.resize(static_cast<std::size_t>(1 + Below(253)));
        for (auto& byte : pdu) byte = Byte();
    }
    return {Below(50) == 0 ? Below(256) : Below(2) * kUnit, pdu};
  }

  /// What ends a connection: a header that is none, or part of a frame.
  Bytes Ending() {
    Bytes bytes = ReadRequest(0, 0, 10);
    switch (Below(3)) {
      case 0:
        bytes[static_cast<std::size_t>(2 + Below(2))] = static_cast<std::uint8_t>(1 + Below(255));  // protocol
        break;
      case 1: {
        const int length = Below(2) == 0 ? Below(2) : 255 + Below(65536 - 255);
        bytes[4] = static_cast<std::uint8_t>(length >> 8);
        bytes[5] = static_cast<std::uint8_t>(length);
        break;
      }
      default:
        bytes.resize(static_cast<std::size_t>(1 + Below(11)));
    }
    return bytes;
  }

 private:
  std::mt19937 random_;
};

/// The PDU of the next reply; empty when the server closed or the header is not that of `transaction` and `unit`.
std::optional<Bytes> ReceivePdu(int socket, int transaction, int unit) {
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds{20};
  Bytes header(7);
  if (!ReceiveAll(socket, header.data(), header.size(), until)) return {};
  const int length = WordAt(header, 4);
  if (WordAt(header, 0) != transaction || WordAt(header, 2) != 0 || header[6] != unit || length < 3 || length > 254) {
    return {};
  }
  Bytes pdu(static_cast<std::size_t>(length - 1));
  if (!ReceiveAll(socket, pdu.data(), pdu.size(), until)) return {};
  return pdu;
}

}  // namespace

MalformedCount SendMalformed(const ServerProcess& server, std::uint64_t frames, std::uint32_t seed) {
  struct Sent {
    int unit;
    Bytes pdu;
  };
  Generator generator(seed);
  MalformedCount count;
  const auto wrong = [&](const Sent& sent) {
    if (++count.wrong_replies > 5) return;
    std::printf("wrong reply to unit %d:", sent.unit);
    for (const auto byte : sent.pdu) std::printf(" %02x", byte);
    std::printf("\n");
  };
  while (count.frames < frames) {
    // Addresses in turn, because each closed connection holds its port for a while.
    const FileDescriptor client = ConnectFrom("127.0.3." + std::to_string(1 + generator.Below(200)), server.Port());
    std::vector<Sent> batch(static_cast<std::size_t>(generator.Below(41)));
    Bytes stream;
    for (std::size_t i = 0; i < batch.size(); ++i) {
      const auto [unit, pdu] = generator.Request();
      batch[i] = {unit, pdu};
      const auto length = static_cast<std::uint8_t>(pdu.size() + 1);
      stream.insert(stream.end(), {0, static_cast<std::uint8_t>(i), 0, 0, 0, length, static_cast<std::uint8_t>(unit)});
      stream.insert(stream.end(), pdu.begin(), pdu.end());
    }
    const Bytes ending = generator.Ending();
    stream.insert(stream.end(), ending.begin(), ending.end());
    (void)!send(client.Get(), stream.data(), stream.size(), MSG_NOSIGNAL);
    shutdown(client.Get(), SHUT_WR);

    bool in_step = true;
    for (std::size_t i = 0; i < batch.size() && in_step; ++i) {
      const Expected expected = Expect(batch[i].unit, batch[i].pdu);
      const auto reply = ReceivePdu(client.Get(), static_cast<int>(i), batch[i].unit);
      in_step = reply.has_value();
      if (expected.exception != 0) ++count.frames;
      if (!reply || !Answers(batch[i].pdu, *reply, expected)) {
        wrong(batch[i]);
      } else {
        ++(expected.exception != 0 ? count.exceptions : count.good);
      }
    }
    ++count.frames;
    std::uint8_t more = 0;
    if (!in_step || recv(client.Get(), &more, 1, 0) > 0) {
      wrong({0, ending});
    } else {
      ++count.closed;
    }
  }
  return count;
}

}  // namespace granary::bench
