// Book data are held to the same ranges whoever gives them.
#include "daemon/control.h"

#include <cmath>
#include <utility>

#include "pipeline/types/bin_faults.h"

namespace granary {

std::vector<std::string> Faults(const BookData& book) {
  const std::pair<const char*, double> figures[] = {{"book_mass_kg", book.book_mass_kg},
                                                    {"density_kg_m3", book.density_kg_m3},
                                                    {"correction", book.correction},
                                                    {"loss_kg", book.loss_kg}};
  std::vector<std::string> faults;
  for (const auto& [name, value] : figures) {
    if (!std::isfinite(value)) faults.push_back(std::string(name) + ": must be a finite number");
  }
  return faults.empty() ? Faults(WithBook({}, book)) : faults;
}

Inventory WithBook(Inventory inventory, const BookData& book) {
  inventory.book_mass_kg = book.book_mass_kg;
  inventory.density_kg_m3 = book.density_kg_m3;
  inventory.correction = book.correction;
  inventory.loss_kg = book.loss_kg;
  return inventory;
}

}  // namespace granary
