// A PLC that was never given book data must not empty the books, and rounding must not look like news each minute.
#include "daemon/modbus/plc_book.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include "daemon/modbus/word_order.h"

namespace granary {
namespace {

constexpr double kKgPerTonne = 1000;

bool IsUnset(float value) { return value == 0 || std::isnan(value); }

/// A PLC may compute its figure with one more rounding than we do, hence one unit in the last place.
bool SameButForRounding(double read, const std::optional<double>& in_force) {
  if (!in_force) return false;
  const double largest = std::max(std::abs(read), std::abs(*in_force));
  return std::abs(read - *in_force) <= largest * std::numeric_limits<float>::epsilon();
}

}  // namespace

PlcBook DecodePlcBook(std::span<const std::uint16_t> words, ByteOrder order) {
  if (words.size() != kPlcBookWords) throw std::invalid_argument("the book data of a bin are 4 registers");
  return {std::bit_cast<float>(Take32(words.first(2), order)), std::bit_cast<float>(Take32(words.last(2), order))};
}

PlcBookVerdict JudgePlcBook(const PlcBook& read, const Inventory& in_force) {
  PlcBookVerdict verdict;
  verdict.book = {.book_mass_kg = read.quantity_t * kKgPerTonne,
                  .density_kg_m3 = read.density_kg_m3,
                  .correction = in_force.correction,
                  .loss_kg = in_force.loss_kg};
  if (IsUnset(read.quantity_t) && IsUnset(read.density_kg_m3)) {
    verdict.finding = PlcBookFinding::kNoData;
  } else if (SameButForRounding(verdict.book.book_mass_kg, in_force.book_mass_kg) &&
             SameButForRounding(verdict.book.density_kg_m3, in_force.density_kg_m3)) {
    verdict.finding = PlcBookFinding::kInForce;
  } else {
    verdict.faults = Faults(verdict.book);
    verdict.finding = verdict.faults.empty() ? PlcBookFinding::kNew : PlcBookFinding::kRefused;
  }
  return verdict;
}

}  // namespace granary
