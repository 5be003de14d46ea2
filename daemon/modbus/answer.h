// What one unit answers to one request, whatever the transport.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "daemon/modbus/framing.h"
#include "daemon/modbus/registers.h"
#include "pipeline/types/bin.h"

namespace granary {

enum class ModbusException : std::uint8_t {
  kIllegalFunction = 0x01,
  kIllegalAddress = 0x02,
  kIllegalValue = 0x03,
  kBusy = 0x06,        ///< "server device busy"
  kNoSuchUnit = 0x0B,  ///< "gateway target device failed to respond"
};

/// The function codes that are served.
namespace function_code {
inline constexpr std::uint8_t kReadCoils = 1;
inline constexpr std::uint8_t kReadDiscreteInputs = 2;
inline constexpr std::uint8_t kReadHoldingRegisters = 3;
inline constexpr std::uint8_t kReadInputRegisters = 4;
inline constexpr std::uint8_t kWriteCoil = 5;
inline constexpr std::uint8_t kWriteRegister = 6;
inline constexpr std::uint8_t kWriteCoils = 15;
inline constexpr std::uint8_t kWriteRegisters = 16;
inline constexpr std::uint8_t kReportServerId = 17;
inline constexpr std::uint8_t kMaskWriteRegister = 22;
inline constexpr std::uint8_t kReadWriteRegisters = 23;
inline constexpr std::uint8_t kEncapsulated = 43;
}  // namespace function_code

using Pdu = std::vector<std::uint8_t>;

/// The reply that refuses a request.
[[nodiscard]] Pdu ExceptionPdu(std::uint8_t function, ModbusException code);

/// One unit at one moment; borrowed.
struct UnitView {
  const RegisterImage& registers;
  std::uint64_t coils;  ///< as CoilBits has them
  const ModbusIdentity& identity;
  const Bin& bin;
};

/// Answers FC1 (coils), FC2 (discrete inputs), FC3 and FC4 (the same registers), FC17 (server id) and FC43/14
/// (identification); everything else is an illegal function.
/// @param request function code and data, 1…253 bytes
[[nodiscard]] Pdu AnswerRequest(std::span<const std::uint8_t> request, const UnitView& unit);
/// FC3, FC4, and the reading half of FC23.
/// @param request function code, address and quantity
[[nodiscard]] Pdu ReadRegisters(std::span<const std::uint8_t> request, const RegisterImage& registers);

}  // namespace granary
