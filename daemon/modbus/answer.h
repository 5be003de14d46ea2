// What one unit answers to one request, whatever the transport.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "daemon/modbus/registers.h"

namespace granary {

enum class ModbusException : std::uint8_t {
  kIllegalFunction = 0x01,
  kIllegalAddress = 0x02,
  kIllegalValue = 0x03,
  kNoSuchUnit = 0x0B,  ///< "gateway target device failed to respond"
};

using Pdu = std::vector<std::uint8_t>;

/// The reply that refuses a request.
[[nodiscard]] Pdu ExceptionPdu(std::uint8_t function, ModbusException code);

/// Answers FC2 (discrete inputs), FC3 and FC4 (the same registers), FC17 (server id) and FC43/14 (identification);
/// everything else, writing included, is an illegal function. A read is one image of one snapshot.
/// @param request function code and data, 1…253 bytes
[[nodiscard]] Pdu AnswerRequest(std::span<const std::uint8_t> request, const RegisterSource& source);

}  // namespace granary
