// A million malformed frames, or as many as GRANARY_MALFORMED_FRAMES says (for sanitizers): each reply is compared with
// what the units answer to that very frame, and with the framing as the test itself understands it.
#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include "daemon/modbus/server.h"
#include "tests/daemon/modbus/client.h"
#include "tests/daemon/modbus/recording_control.h"
#include "tests/daemon/modbus/snapshots.h"

namespace granary {
namespace {

using test::Bytes;
using test::RawClient;

/// A frame as the specification has it; the test's own reading, not the server's.
struct Expected {
  Bytes transaction;
  Bytes request;  ///< unit and PDU
};

/// What a server must make of a stream: the frames that it answers, until the stream goes wrong or ends.
std::vector<Expected> Understand(const Bytes& stream) {
  std::vector<Expected> frames;
  std::size_t at = 0;
  while (stream.size() - at >= 6) {
    const std::size_t length = stream[at + 4] * 256U + stream[at + 5];
    if (stream[at + 2] != 0 || stream[at + 3] != 0 || length < 2 || length > 254) break;
    if (stream.size() - at < 6 + length) break;
    const auto begin = stream.begin() + static_cast<std::ptrdiff_t>(at);
    frames.push_back({{begin, begin + 2}, {begin + 6, begin + static_cast<std::ptrdiff_t>(6 + length)}});
    at += 6 + length;
  }
  return frames;
}

class Mutator {
 public:
  explicit Mutator(std::uint32_t seed) : random_(seed) {}

  /// A good frame with something wrong: mostly inside, so that the stream goes on.
  Bytes Frame() {
    Bytes frame = Good();
    switch (Below(8)) {
      case 0:  // any function, any data
        for (std::size_t i = 7; i < frame.size(); ++i) frame[i] = Byte();
        break;
      case 1:  // one byte of unit or PDU
      case 2:
        frame[6 + Below(frame.size() - 6)] = Byte();
        break;
      case 3:  // shorter, and the header knows
        frame.resize(8 + Below(frame.size() - 7));
        break;
      case 4:  // longer, and the header knows
        for (std::size_t more = 1 + Below(200); more > 0; --more) frame.push_back(Byte());
        break;
      case 5:  // quantity 0, or far too many
        if (frame.size() >= 12) frame[10] = Below(2) == 0 ? 0 : 0xFF, frame[11] = 0;
        break;
      case 6:  // address beyond the map
        if (frame.size() >= 10) frame[8] = 0x0F, frame[9] = static_cast<std::uint8_t>(0xA0 + Below(96));
        break;
      default:
        frame[7] = Byte();
    }
    if (frame.size() > 260) frame.resize(260);
    frame[4] = 0;
    frame[5] = static_cast<std::uint8_t>(frame.size() - 6);
    return frame;
  }

  /// What ends a stream: a header that is none, a frame cut off, or noise.
  Bytes End() {
    Bytes frame = Good();
    switch (Below(4)) {
      case 0:
        frame[2 + Below(4)] = static_cast<std::uint8_t>(1 + Below(255));
        break;
      case 1:
        frame.resize(1 + Below(frame.size() - 1));
        break;
      case 2:
        frame[4] = frame[5] = 0;
        break;
      default:
        frame.resize(1 + Below(300));
        for (auto& byte : frame) byte = Byte();
    }
    return frame;
  }

  std::size_t Below(std::size_t end) { return random_() % end; }

 private:
  std::uint8_t Byte() { return static_cast<std::uint8_t>(random_()); }

  Bytes Good() {
    static const std::vector<Bytes> kPdus{{3, 0, 0, 0, 65},
                                          {4, 0, 10, 0, 2},
                                          {2, 0, 0, 0, 48},
                                          {17},
                                          {43, 14, 4, 1},
                                          {43, 14, 1, 0},
                                          {6, 0x03, 0x84, 0, 1},
                                          {16, 0x03, 0x98, 0, 2, 4, 0x41, 0x20, 0, 0},
                                          {22, 0x03, 0x84, 0, 0, 0, 1},
                                          {23, 0, 0, 0, 10, 0x03, 0x84, 0, 1, 2, 0, 1},
                                          {1, 0, 0, 0, 8},
                                          {5, 0, 0, 0xFF, 0},
                                          {15, 0, 0, 0, 8, 1, 0xFF},
                                          {8, 0, 0, 0xA5, 0x37}};
    const Bytes& pdu = kPdus[Below(kPdus.size())];
    Bytes frame(7 + pdu.size());
    frame[0] = Byte();
    frame[1] = Byte();
    frame[5] = static_cast<std::uint8_t>(pdu.size() + 1);
    frame[6] = 3;
    std::copy(pdu.begin(), pdu.end(), frame.begin() + 7);
    return frame;
  }

  std::mt19937 random_;
};

/// The server's own counters move from one request to the next: of a read that shows them only the shape is compared.
bool ShowsCounters(const Bytes& request) {
  if (request.size() < 6) return false;
  const std::uint8_t function = request[1];
  const unsigned address = request[2] * 256U + request[3], count = request[4] * 256U + request[5];
  return (function == 3 || function == 4 || function == 23) && address < 300 && address + count > 200;
}

struct Tally {
  std::uint64_t frames = 0, answered = 0;
  std::vector<std::string> wrong;
};

std::string Print(const Bytes& bytes) {
  std::string text;
  for (const auto byte : bytes) text += std::to_string(byte) + " ";
  return text;
}

/// Sends one stream over a connection of its own and compares everything that comes back.
void SendStream(std::uint16_t port, ModbusUnits& units, Mutator& mutate, std::size_t frames, Tally& tally) {
  Bytes stream;
  for (std::size_t i = 0; i < frames; ++i) {
    const Bytes frame = mutate.Frame();
    stream.insert(stream.end(), frame.begin(), frame.end());
  }
  const Bytes end = mutate.End();
  stream.insert(stream.end(), end.begin(), end.end());

  RawClient client(port);
  if (!client.Send(stream)) return tally.wrong.push_back("the server closed before the stream was sent");
  client.EndSending();
  const std::vector<Expected> expected = Understand(stream);
  const Requester nobody{"127.0.0.1:1", false};
  for (const auto& frame : expected) {
    const Pdu pdu = units.Answer(frame.request[0], std::span(frame.request).subspan(1), nobody);
    Bytes wanted = frame.transaction;
    const auto length = static_cast<std::uint8_t>(pdu.size() + 1);
    for (const std::uint8_t byte : {std::uint8_t{0}, std::uint8_t{0}, std::uint8_t{0}, length, frame.request[0]}) {
      wanted.push_back(byte);
    }
    wanted.insert(wanted.end(), pdu.begin(), pdu.end());
    Bytes got = client.Receive(wanted.size());
    const bool shape_only = ShowsCounters(frame.request) && got.size() > 8;
    if (shape_only) std::copy(wanted.begin() + 8, wanted.end(), got.begin() + 8);
    if (got != wanted) {
      tally.wrong.push_back("to " + Print(frame.request) + "came " + Print(got) + "and not " + Print(wanted));
      return;
    }
    ++tally.answered;
  }
  if (!client.Receive(1).empty()) tally.wrong.push_back("an answer to what is no frame");
  tally.frames += frames + 1;
}

TEST(ModbusServerMalformed, EveryReplyIsTheRightOneForItsFrame) {
  const char* const wanted = std::getenv("GRANARY_MALFORMED_FRAMES");
  const std::uint64_t frames = wanted == nullptr ? 1000000 : std::strtoull(wanted, nullptr, 10);
  spdlog::set_level(spdlog::level::off);
  test::RecordingControl control;
  ModbusTally counts;
  ModbusUnits units(test::kIdentity, {test::GoodSnapshot().bin}, control, counts,
                    [] { return test::kMeasuredAt + std::chrono::seconds{90}; });
  units.Publish(test::GoodSnapshot());
  ModbusServer server(ListenTcp("127.0.0.1", 0), {}, units, counts);

  constexpr int kSenders = 2;
  std::vector<Tally> tallies(kSenders);
  {
    std::vector<std::jthread> senders;
    for (int sender = 0; sender < kSenders; ++sender) {
      senders.emplace_back([&, sender] {
        Mutator mutate(static_cast<std::uint32_t>(41 + sender));
        Tally& tally = tallies[sender];
        while (tally.frames < frames / kSenders && tally.wrong.empty()) {
          SendStream(server.Port(), units, mutate, 1 + mutate.Below(150), tally);
        }
      });
    }
  }
  std::uint64_t answered = 0, sent = 0;
  for (const auto& tally : tallies) {
    for (const auto& wrong : tally.wrong) ADD_FAILURE() << wrong;
    answered += tally.answered;
    sent += tally.frames;
  }
  spdlog::set_level(spdlog::level::info);
  RecordProperty("frames", std::to_string(sent));
  std::printf("%llu frames, %llu answered\n", static_cast<unsigned long long>(sent),
              static_cast<unsigned long long>(answered));
  EXPECT_GE(sent, frames);
  EXPECT_TRUE(control.chosen().empty() && control.committed().empty() && control.asked().empty());
}

}  // namespace
}  // namespace granary
