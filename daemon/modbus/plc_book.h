// Book data as a PLC keeps them, and what is to be done about them.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "daemon/control.h"
#include "daemon/options.h"
#include "pipeline/types/bin.h"

namespace granary {

inline constexpr int kPlcBookWords = 4;  ///< registers a bin

/// What a PLC says of one bin.
struct PlcBook {
  float quantity_t = 0;
  float density_kg_m3 = 0;
  bool operator==(const PlcBook&) const = default;
};

/// Two float32, quantity first. @param words kPlcBookWords of them @throws std::invalid_argument for another number
[[nodiscard]] PlcBook DecodePlcBook(std::span<const std::uint16_t> words, ByteOrder order);

enum class PlcBookFinding : std::uint8_t {
  kInForce,  ///< the same as in force, but for the rounding to float32
  kNoData,   ///< both are 0 or NaN: nobody has filled them in
  kRefused,  ///< out of range
  kNew       ///< to be committed
};

struct PlcBookVerdict {
  PlcBookFinding finding = PlcBookFinding::kInForce;
  BookData book;                    ///< what would be committed; correction and loss are those in force
  std::vector<std::string> faults;  ///< why refused
};

/// Compares what was read with what is in force.
[[nodiscard]] PlcBookVerdict JudgePlcBook(const PlcBook& read, const Inventory& in_force);

}  // namespace granary
