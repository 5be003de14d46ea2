// A framing that listens to a line on which time passes only when a test says so.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <utility>
#include <vector>

#include "daemon/modbus/rtu_framing.h"

namespace granary::test {

using Bytes = std::vector<std::uint8_t>;

inline constexpr int kUs = 3, kNeighbour = 7;

/// A request to read registers.
inline Bytes ReadRequest(int address, int first = 0, int count = 1) {
  return RtuFrame(static_cast<std::uint8_t>(address),
                  Bytes{3, static_cast<std::uint8_t>(first >> 8), static_cast<std::uint8_t>(first),
                        static_cast<std::uint8_t>(count >> 8), static_cast<std::uint8_t>(count)});
}
inline Bytes WriteRequest(int address, int value = 1) {
  return RtuFrame(static_cast<std::uint8_t>(address), Bytes{6, 0x03, 0x84, 0, static_cast<std::uint8_t>(value)});
}
/// A reply with these register bytes.
inline Bytes ReadReply(int address, const Bytes& data) {
  Bytes pdu{3, static_cast<std::uint8_t>(data.size())};
  pdu.insert(pdu.end(), data.begin(), data.end());
  return RtuFrame(static_cast<std::uint8_t>(address), pdu);
}
inline Bytes Joined(std::initializer_list<Bytes> parts) {
  Bytes all;
  for (const auto& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}
inline Bytes Part(const Bytes& bytes, std::size_t begin, std::size_t end) {
  return {bytes.begin() + static_cast<std::ptrdiff_t>(begin), bytes.begin() + static_cast<std::ptrdiff_t>(end)};
}

class Listener {
 public:
  explicit Listener(int baud = 19200)
      : timing_(TimingOf(baud)),
        framing_(
            timing_, [](std::uint8_t address) { return address == kUs; }, tally_) {}

  /// The bytes pass over the line and are read at once when the last is there.
  Listener& Hear(const Bytes& bytes) {
    Wait(timing_.character * static_cast<int>(bytes.size()) - std::chrono::nanoseconds{1});
    now_ += std::chrono::nanoseconds{1};
    framing_.Receive(bytes, now_);
    return *this;
  }
  /// Time passes, and the framing is asked whenever it wants to be.
  Listener& Wait(std::chrono::nanoseconds time) {
    const auto end = now_ + time;
    while (framing_.Deadline() && *framing_.Deadline() <= end) {
      now_ = *framing_.Deadline();
      while (auto request = framing_.Next(now_)) requests_.push_back(RtuFrame(request->address, request->pdu));
    }
    now_ = end;
    return *this;
  }
  /// The silence that the standard wants between two frames.
  Listener& Pause() { return Wait(timing_.t35); }
  Listener& Send(const Bytes& frame) {
    now_ += timing_.character * static_cast<int>(frame.size());
    framing_.Sent(frame, now_);
    return *this;
  }
  /// The requests found since the last call, as whole frames.
  std::vector<Bytes> Take() { return std::exchange(requests_, {}); }

  [[nodiscard]] ModbusCounters Counters() const { return tally_.Read(); }
  [[nodiscard]] const RtuTiming& Timing() const { return timing_; }

 private:
  RtuTiming timing_;
  ModbusTally tally_;
  RtuFraming framing_;
  RtuFraming::Time now_{std::chrono::hours{1}};
  std::vector<Bytes> requests_;
};

/// Longer than anything unfinished is waited for.
inline constexpr std::chrono::seconds kLong{1};

}  // namespace granary::test
