// A client's stream of bytes, from the framing to what is written into the bin.
//
// Input: one byte of circumstances (bit 0 may write, 1 the bin is ready, 2 book data may be written, 3–4 which
// snapshot), then the stream. A frame's transaction number has no meaning for the server, so that here its bits say
// from which host (bit 0) and how many seconds after the frame before (bits 8–15) it comes.
#include <chrono>
#include <cstdint>
#include <span>
#include <vector>

#include <spdlog/spdlog.h>

#include "daemon/modbus/framing.h"
#include "daemon/modbus/units.h"
#include "tests/daemon/modbus/snapshots.h"
#include "tests/fuzz/invariants.h"

namespace granary::fuzz {
namespace {

BinSnapshot SnapshotOf(std::uint8_t circumstances) {
  BinSnapshot snapshot;
  switch ((circumstances >> 3) & 3) {
    case 0:
      snapshot = test::GoodSnapshot();
      break;
    case 1:
      snapshot = test::UnmeasuredSnapshot();
      break;
    case 2:
      snapshot = test::HeldSnapshot(Reason::kFrameMissing);
      break;
    default:
      snapshot = test::GoodSnapshot();
      snapshot.injected = true;
  }
  snapshot.book.writable = (circumstances & 4) != 0;
  if (snapshot.good) snapshot.book.in_force.book_mass_kg = snapshot.good->book_mass_kg;
  return snapshot;
}

/// What is judged of a stream's beginning is never taken back when more comes.
void CheckPrefixes(std::span<const std::uint8_t> stream, const ModbusFrame& whole) {
  const std::size_t end = whole.state == FrameState::kComplete ? whole.bytes : std::min<std::size_t>(stream.size(), 8);
  for (std::size_t bytes = 0; bytes < end; ++bytes) {
    const ModbusFrame part = ParseFrame(stream.first(bytes));
    if (part.state == FrameState::kIncomplete) continue;
    Require(part.state == FrameState::kMalformed && whole.state == FrameState::kMalformed,
            "a part of a frame is no frame, and a frame is never malformed in part");
    return;
  }
}

class Fuzzed {
 public:
  explicit Fuzzed(std::uint8_t circumstances) : may_write_((circumstances & 1) != 0) {
    control_.ready = (circumstances & 2) != 0;
    control_.snapshot = SnapshotOf(circumstances);
    control_.units = &units_;
    units_.Publish(control_.snapshot);
  }

  void Answer(const ModbusFrame& frame) {
    seconds_ += frame.transaction >> 8;
    const Requester requester{(frame.transaction & 1) == 0 ? "192.168.7.20:40112" : "192.168.7.21:5", may_write_};
    const std::uint64_t effects = control_.effects;
    const Pdu reply = units_.Answer(frame.unit, frame.pdu, requester);
    CheckReply(frame.pdu, reply);
    const bool refused = (reply[0] & 0x80) != 0;
    const std::uint64_t done = control_.effects - effects;
    Require(done <= 1, "a request does one thing");
    Require(done == 0 || (may_write_ && control_.ready && !refused), "what is refused does nothing");

    std::vector<std::uint8_t> wire;
    AppendFrame(frame.transaction, frame.unit, reply, wire);
    const ModbusFrame back = ParseFrame(wire);
    Require(back.state == FrameState::kComplete && back.bytes == wire.size(), "a reply is a frame");
  }

  /// A block read is one snapshot, whatever happened before.
  void CheckSummary() {
    constexpr std::uint8_t kRead[] = {3, 0, 0, 0, 65};
    const Pdu reply = units_.Answer(0, kRead, {"192.168.7.22:1", false});
    Require(reply.size() == 2 + 2 * 65, "the summary can always be read");
    Require(reply[2 + 10] == reply[2 + 128] && reply[3 + 10] == reply[3 + 128], "registers 5 and 64 are equal");
    Require(reply == units_.Answer(3, kRead, {"192.168.7.23:1", true}), "the same at the same moment for everybody");
  }

 private:
  const bool may_write_;
  std::int64_t seconds_ = 90;
  ObedientControl control_;
  ModbusTally tally_;
  ModbusUnits units_{test::kIdentity,
                     {test::GoodSnapshot().bin},
                     control_,
                     tally_,
                     [this] { return UtcTime(test::kMeasuredAt + std::chrono::seconds{seconds_}); },
                     [this] { return std::chrono::steady_clock::time_point(std::chrono::seconds{seconds_}); }};
};

}  // namespace
}  // namespace granary::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace granary;
  if (size == 0) return 0;
  spdlog::set_level(spdlog::level::off);
  fuzz::Fuzzed fuzzed(data[0]);
  std::span<const std::uint8_t> stream(data + 1, size - 1);
  while (true) {
    const ModbusFrame frame = ParseFrame(stream);
    fuzz::CheckPrefixes(stream, frame);
    if (frame.state != FrameState::kComplete) break;
    fuzzed.Answer(frame);
    stream = stream.subspan(frame.bytes);
  }
  fuzzed.CheckSummary();
  return 0;
}
