// Every step needs the one before; the first unknown input ends the chain and leaves what follows empty.
#include "pipeline/inventory.h"

#include <cmath>
#include <optional>

namespace granary {
namespace {

bool IsPositive(double value) { return std::isfinite(value) && value > 0; }

std::optional<double> KnownPositive(const std::optional<double>& value) {
  return value && IsPositive(*value) ? value : std::nullopt;
}

void Clear(Measurement& m) {
  m.density_kg_m3 = m.correction = m.loss_kg = m.mass_kg = m.mass_check_kg = m.book_mass_kg = std::nullopt;
  m.error_rate_percent = m.error_rate_u95_percent = std::nullopt;
  m.abnormal = std::nullopt;
}

}  // namespace

void ApplyInventory(Measurement& measurement, const Inventory& inventory) {
  Measurement& m = measurement;
  Clear(m);
  if (!m.valid || !m.volume_m3 || !std::isfinite(*m.volume_m3)) return;
  m.density_kg_m3 = KnownPositive(inventory.density_kg_m3);
  m.book_mass_kg = KnownPositive(inventory.book_mass_kg);
  if (IsPositive(inventory.correction)) m.correction = inventory.correction;
  if (std::isfinite(inventory.loss_kg)) m.loss_kg = inventory.loss_kg;

  if (!m.density_kg_m3 || !m.correction) return;
  const double mass_per_m3 = *m.correction * *m.density_kg_m3;
  m.mass_kg = *m.volume_m3 * mass_per_m3;
  if (!m.loss_kg) return;
  m.mass_check_kg = *m.mass_kg + *m.loss_kg;
  if (!m.book_mass_kg) return;
  m.error_rate_percent = (*m.mass_check_kg - *m.book_mass_kg) / *m.book_mass_kg * 100;
  m.abnormal = std::abs(*m.error_rate_percent) > inventory.alarm_percent;

  if (!m.volume_u95_m3) return;
  const double from_volume_kg = mass_per_m3 * *m.volume_u95_m3;
  const double from_density_kg = *m.mass_kg * inventory.density_u95_percent.value_or(0) / 100;
  m.error_rate_u95_percent = std::hypot(from_volume_kg, from_density_kg) / *m.book_mass_kg * 100;
}

}  // namespace granary
