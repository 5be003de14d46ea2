// Finds the requests to us in what is heard on a shared serial line.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "daemon/modbus/rtu_frame.h"
#include "daemon/modbus/tally.h"

namespace granary {

struct RtuRequest {
  std::uint8_t address = 0;       ///< 0: to all, never answered
  std::vector<std::uint8_t> pdu;  ///< function code and data
};

/// Holds no clock and no port: times are when bytes were read. Not thread-safe: it belongs to the server's thread.
class RtuFraming {
 public:
  using Time = std::chrono::steady_clock::time_point;

  /// @param serves whether an address is ours; never asked for 0 and above 247
  /// @param tally borrowed; `rtu_others` and `rtu_errors` are counted here
  RtuFraming(const RtuTiming& timing, std::function<bool(std::uint8_t)> serves, ModbusTally& tally);

  /// Bytes that one read gave.
  void Receive(std::span<const std::uint8_t> bytes, Time now);
  /// When Next is to be called unless bytes come before; empty while nothing is waiting.
  [[nodiscard]] std::optional<Time> Deadline() const;
  /// The next request: its checksum is good, its length fits its function, nothing but silence follows it, and the line
  /// has been silent for t3.5. To be called until empty, and only when there is nothing to read.
  [[nodiscard]] std::optional<RtuRequest> Next(Time now);
  /// Tells of a frame that we have sent, so that it is not taken for a request when it is heard. Forgets what came
  /// before it. @param now when its last byte was out
  void Sent(std::span<const std::uint8_t> frame, Time now);

 private:
  enum class Found : std::uint8_t { kNothing, kUnfinished, kRequest, kOther, kEcho };
  struct Match {
    Found found = Found::kNothing;
    std::size_t bytes = 0;  ///< of the frame; what is missing when unfinished
  };
  /// Whether the line lets us hear what we send, as far as the answers sent have shown.
  enum class Echo : std::uint8_t { kUnknown, kHeard, kAbsent };

  [[nodiscard]] Match MatchAt(std::span<const std::uint8_t> rest) const;
  [[nodiscard]] Match MatchEcho(std::span<const std::uint8_t> rest) const;
  [[nodiscard]] Match MatchBetweenPauses(std::span<const std::uint8_t> rest, bool ours) const;
  [[nodiscard]] bool EndsInRequest(std::span<const std::uint8_t> rest) const;
  [[nodiscard]] bool IsOurs(std::uint8_t address) const;
  void Drop(std::size_t bytes);
  void DropNoise();
  void EndEcho(Echo learnt);

  const RtuTiming timing_;
  const std::function<bool(std::uint8_t)> serves_;
  ModbusTally& tally_;

  std::vector<std::uint8_t> heard_;
  std::size_t begin_ = 0;            ///< first byte of `heard_` that is not yet judged
  std::vector<std::size_t> pauses_;  ///< ascending places in `heard_` before which the line paused for more than t1.5
  Time newest_{};                    ///< when the newest bytes were read
  std::optional<Time> wait_until_;   ///< how long the rest of an unfinished frame may take
  bool in_noise_ = false;            ///< the byte before `begin_` belonged to no frame, and no pause follows

  std::vector<std::uint8_t> sent_;  ///< our newest answer until it has been heard or cannot be any more
  Time echo_until_{};
  bool echo_spoiled_ = false;  ///< noise came since, which may have been it
  Echo echo_ = Echo::kUnknown;
};

}  // namespace granary
