// Modbus RTU frames: checksum, how long a frame says it is, and the times of a serial line.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace granary {

inline constexpr std::size_t kMinRtuBytes = 4;    ///< address, function, checksum
inline constexpr std::size_t kMaxRtuBytes = 256;  ///< address, PDU of 253 bytes, checksum

/// What a speed means for framing.
struct RtuTiming {
  std::chrono::nanoseconds character;  ///< 11 bits: start, 8 data, parity or second stop bit, stop
  std::chrono::nanoseconds t15;        ///< the longest pause inside a frame
  std::chrono::nanoseconds t35;        ///< the shortest silence between frames
};

/// 1.5 and 3.5 characters; above 19200 bit/s fixed at 750 and 1750 µs.
/// Source: Modbus over Serial Line V1.02, §2.5.1.1.
/// @param baud bit/s, more than 0
[[nodiscard]] RtuTiming TimingOf(int baud);

/// CRC-16/Modbus; goes over the wire low byte first. Over a frame with its own checksum it is 0.
[[nodiscard]] std::uint16_t Crc16(std::span<const std::uint8_t> bytes);

/// A whole frame around `pdu`. @throws std::length_error when the PDU has not 1 to 253 bytes
[[nodiscard]] std::vector<std::uint8_t> RtuFrame(std::uint8_t address, std::span<const std::uint8_t> pdu);

/// How long a request is, or a reply, that begins with these bytes: the whole frame with address and checksum. Exact
/// once that many bytes are there, before at least so long. @return 0 when the function says nothing about its length,
/// or the frame would be longer than 256 bytes
[[nodiscard]] std::size_t RequestBytes(std::span<const std::uint8_t> frame);
[[nodiscard]] std::size_t ReplyBytes(std::span<const std::uint8_t> frame);

}  // namespace granary
