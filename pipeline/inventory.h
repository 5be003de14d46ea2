// From a volume to a quantity and its disagreement with the books (METHOD §7).
#pragma once

#include "pipeline/types/bin.h"
#include "pipeline/types/measurement.h"

namespace granary {

/// Fills the inventory fields of `measurement` from its volume and the book data.
///
/// m = V · k · ρ;  m_check = m + L;  e = (m_check − book) / book · 100 %;  abnormal when |e| exceeds the alarm limit.
/// The expanded uncertainty of e combines those of volume and density in quadrature, in percentage points of the book
/// quantity; empty when that of the volume is unknown. An unknown density is not taken for an exact one: without
/// `density_u95_percent` the figure covers the volume alone.
///
/// What cannot be computed is empty, never 0: everything when the measurement is invalid or its volume unknown; masses
/// when the density is unknown or not above 0 (likewise the correction); error rate and verdict when the book quantity
/// is unknown or not above 0. Source: Zhao 2023, §1 and §6.
void ApplyInventory(Measurement& measurement, const Inventory& inventory);

}  // namespace granary
