// Modbus TCP frames: where one begins and ends in a stream of bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

namespace granary {

inline constexpr std::size_t kMbapBytes = 7;  ///< transaction, protocol, length, unit
inline constexpr std::size_t kMaxPduBytes = 253;
inline constexpr std::size_t kMaxFrameBytes = kMbapBytes + kMaxPduBytes;

/// The big-endian 16 bits that begin at `index`.
[[nodiscard]] constexpr std::uint16_t WordAt(std::span<const std::uint8_t> bytes, std::size_t index) {
  return static_cast<std::uint16_t>((bytes[index] << 8) | bytes[index + 1]);
}

enum class FrameState : std::uint8_t { kIncomplete, kComplete, kMalformed };

/// The first frame of a stream. `pdu` borrows from the bytes it was parsed from.
struct ModbusFrame {
  FrameState state = FrameState::kIncomplete;
  std::string_view fault;  ///< why malformed
  std::size_t bytes = 0;   ///< length of the whole frame when complete
  std::uint16_t transaction = 0;
  std::uint8_t unit = 0;
  std::span<const std::uint8_t> pdu;  ///< function code and data
};

/// Reads the frame that `stream` begins with. A header that cannot begin a request is malformed as soon as the wrong
/// byte is there; a stream gone wrong has no next frame.
[[nodiscard]] ModbusFrame ParseFrame(std::span<const std::uint8_t> stream);

/// Appends a frame around `pdu` to `stream`. @throws std::length_error when the PDU exceeds 253 bytes.
void AppendFrame(std::uint16_t transaction, std::uint8_t unit, std::span<const std::uint8_t> pdu,
                 std::vector<std::uint8_t>& stream);

}  // namespace granary
