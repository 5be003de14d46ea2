// What is heard on a shared serial line, from the bytes to the answer.
//
// Input: one byte of circumstances (bit 0 the master may write, 1 and 2 as in modbus_fuzz.cpp, 3 we hear what we send,
// 4–6 the speed), then what one read after the other gave: a byte with the pause before it in quarters of a character
// (0–255, so up to 64 characters) and one with the number of bytes (1–32), then those bytes. A length from 128 on
// repairs the last two bytes to the checksum, so that the fuzzer need not guess it.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <span>
#include <vector>

#include <spdlog/spdlog.h>

#include "daemon/modbus/rtu_framing.h"
#include "daemon/modbus/units.h"
#include "tests/daemon/modbus/snapshots.h"
#include "tests/fuzz/invariants.h"

namespace {

using namespace granary;
using fuzz::Require;

constexpr int kUnit = 3;
constexpr std::array<int, 8> kBauds{1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  spdlog::set_level(spdlog::level::off);
  const std::uint8_t circumstances = data[0];
  const bool may_write = (circumstances & 1) != 0, echoes = (circumstances & 8) != 0;
  fuzz::ObedientControl control;
  control.ready = (circumstances & 2) != 0;
  control.snapshot = test::GoodSnapshot();
  control.snapshot.book.writable = (circumstances & 4) != 0;
  ModbusTally tally;
  RtuFraming::Time now{};
  ModbusUnits units(
      test::kIdentity, {control.snapshot.bin}, control, tally,
      [&] {
        return UtcTime(test::kMeasuredAt +
                       std::chrono::duration_cast<std::chrono::milliseconds>(now.time_since_epoch()));
      },
      [&] { return now; });
  control.units = &units;
  units.Publish(control.snapshot);

  const RtuTiming timing = TimingOf(kBauds[(circumstances >> 4) & 7]);
  RtuFraming framing(
      timing, [](std::uint8_t address) { return address == kUnit; }, tally);

  std::vector<std::uint8_t> echo;
  // Everything that is waiting is taken at the moments that the framing asks for, as its server does.
  const auto serve_until = [&](RtuFraming::Time end) {
    while (const auto deadline = framing.Deadline()) {
      if (*deadline > end) return;
      now = std::max(now, *deadline);
      bool any = false;
      while (const auto request = framing.Next(now)) {
        any = true;
        Require(request->address == 0 || request->address == kUnit, "only requests to us, or to all, are answered");
        Require(!request->pdu.empty() && request->pdu.size() <= kMaxPduBytes, "a request has 1 to 253 bytes");
        const std::uint64_t effects = control.effects;
        const Pdu reply = units.Answer(request->address, request->pdu, {"/dev/ttyS1", may_write});
        fuzz::CheckReply(request->pdu, reply);
        Require(control.effects == effects || (may_write && control.ready && (reply[0] & 0x80) == 0),
                "what is refused does nothing");
        if (request->address == 0) continue;
        const std::vector<std::uint8_t> frame = RtuFrame(request->address, reply);
        Require(frame.size() <= kMaxRtuBytes && Crc16(frame) == 0, "an answer is a frame");
        now += timing.character * frame.size();
        framing.Sent(frame, now);
        if (echoes) echo.insert(echo.end(), frame.begin(), frame.end());
      }
      const auto again = framing.Deadline();
      Require(any || !again || *again > *deadline, "a deadline that brought nothing is over");
    }
  };

  std::span<const std::uint8_t> rest(data + 1, size - 1);
  while (rest.size() >= 3) {
    const auto due = now + timing.character * rest[0] / 4;
    const bool repaired = rest[1] >= 128;
    const std::size_t count = std::min<std::size_t>(1 + rest[1] % 32, rest.size() - 2);
    std::vector<std::uint8_t> bytes(rest.begin() + 2, rest.begin() + 2 + static_cast<std::ptrdiff_t>(count));
    rest = rest.subspan(2 + count);
    if (repaired && bytes.size() >= 4) {
      const std::uint16_t crc = Crc16(std::span(bytes).first(bytes.size() - 2));
      bytes[bytes.size() - 2] = static_cast<std::uint8_t>(crc);
      bytes[bytes.size() - 1] = static_cast<std::uint8_t>(crc >> 8);
    }
    serve_until(due);
    now = std::max(now, due);
    if (!echo.empty()) framing.Receive(echo, now);
    echo.clear();
    framing.Receive(bytes, now);
  }
  serve_until(now + std::chrono::seconds{10});
  Require(!framing.Deadline() || !echo.empty(), "a silent line leaves nothing to wait for");
  return 0;
}
