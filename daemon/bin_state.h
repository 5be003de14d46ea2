// What the daemon remembers of a bin besides its measurements: what clients wrote, and who.
#pragma once

#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "daemon/control.h"
#include "daemon/options.h"
#include "pipeline/types/frame.h"

namespace granary {

/// The state of one bin that a restart keeps. What is empty was never written.
struct BinState {
  struct Book {
    BookData data;
    UtcTime utc{};  ///< when they were committed
    std::string who;
    bool operator==(const Book&) const = default;
  };
  struct Inhibition {
    UtcTime utc{};
    std::string who;
    bool operator==(const Inhibition&) const = default;
  };
  std::optional<Book> book;  ///< the newest that a client committed
  std::optional<RegisterFormat> format;
  std::optional<Inhibition> inhibition;  ///< nothing is captured until somebody releases the bin
  std::optional<bool> abnormal_latched;
  bool operator==(const BinState&) const = default;
};

/// One line of the journal: who changed what of a bin.
struct JournalEntry {
  UtcTime utc{};
  int bin = 1;
  std::string who;     ///< as in BinControl
  std::string what;    ///< book | format | inhibit | release | acknowledge | inject | inject_end
  std::string before;  ///< JSON text; empty when there is nothing to say
  std::string after;
};

/// {"book_mass_kg":…,"density_kg_m3":…,"correction":…,"loss_kg":…}; unknown is null.
[[nodiscard]] nlohmann::ordered_json BookToJson(const Inventory& inventory);
/// {"byte_order":0,"invalid":0}, the numbers of registers 900 and 901.
[[nodiscard]] nlohmann::ordered_json FormatToJson(const RegisterFormat& format);

/// Everything that is there, under "book" (with "utc_ns", Unix time, and "who"), "format", "inhibition",
/// "abnormal_latched".
[[nodiscard]] nlohmann::ordered_json StateToJson(const BinState& state);
/// The inverse; keys that it does not know are left alone.
/// @throws std::invalid_argument for what is no state, naming the key
[[nodiscard]] BinState StateFromJson(const nlohmann::ordered_json& json);

}  // namespace granary
