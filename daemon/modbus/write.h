// What a request to write asks for, checked whole before any of it is done.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>

#include "daemon/control.h"
#include "daemon/modbus/answer.h"
#include "daemon/modbus/connection.h"
#include "daemon/modbus/registers.h"
#include "daemon/snapshot.h"
#include "pipeline/types/bin.h"

namespace granary {

/// Registers 920…927: book quantity, density, correction and loss, two words each; those not written are empty.
using BookWords = std::array<std::optional<std::uint16_t>, 8>;

/// A write to registers 920…930.
struct BookWrite {
  BookWords words;
  bool commit = false;  ///< register 930 is among them
  bool operator==(const BookWrite&) const = default;
};

/// What is to be done: nothing (a coil switched off that does nothing when off), refuse, or one of three things.
using WritePlan = std::variant<std::monostate, ModbusException, RegisterFormat, BinCommand, BookWrite>;

/// FC5, 6, 15, 16, 22 and 23.
[[nodiscard]] bool IsWrite(std::uint8_t function);

/// @param request of a function that IsWrite, 1…253 bytes; of FC23 the reading half is not looked at
/// @param registers the image that FC22 masks
[[nodiscard]] WritePlan PlanWrite(std::span<const std::uint8_t> request, const BinSnapshot& snapshot,
                                  const RegisterImage& registers);

/// Book data that one client has begun to write and not committed yet.
struct BookStage {
  std::string host;  ///< whose they are
  SteadyTime until;  ///< when they are forgotten
  BookWords words;
};

/// What a commit of the words would put in force: figures not written stay as they are. A figure that is unknown, or of
/// which one word alone was written, is NaN, which no commit takes.
[[nodiscard]] BookData BookOf(const BookWords& words, const Inventory& in_force);
/// Shows staged words in registers 920…927, and in 930 that there are some.
void ShowStage(const BookStage& stage, RegisterImage& registers);

/// A requester's name without its port: a PLC that reconnects is still the same.
[[nodiscard]] std::string_view HostOf(std::string_view name);

}  // namespace granary
