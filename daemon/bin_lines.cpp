// Figures are given to the digits that mean something, and every trouble with what to do about it.
#include "daemon/bin_lines.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "daemon/record_json.h"

namespace granary {

std::string NameOf(const Bin& bin) {
  return bin.name.empty() ? fmt::format("bin {}", bin.id) : fmt::format("bin {} {}", bin.id, bin.name);
}

std::string VolumeText(const Measurement& m) {
  if (!m.volume_m3) return "no volume";
  if (!m.volume_u95_m3 || !(*m.volume_u95_m3 > 0)) return fmt::format("{:.5g} m³", *m.volume_m3);
  const int digits = std::max(0, 1 - static_cast<int>(std::floor(std::log10(*m.volume_u95_m3))) - 1);
  return fmt::format("{:.{}f} m³ ±{:.{}f}", *m.volume_m3, digits, *m.volume_u95_m3, digits);
}

std::string CycleLine(const Bin& bin, const Measurement& m) {
  std::string line = NameOf(bin) + ": " + VolumeText(m);
  if (m.mass_kg && *m.mass_kg < 1000.0) line += fmt::format(", {:.2f} kg", *m.mass_kg);
  if (m.mass_kg && *m.mass_kg >= 1000.0) line += fmt::format(", {:.2f} t", *m.mass_kg / 1000.0);
  if (m.error_rate_percent) {
    const double tenths = std::round(*m.error_rate_percent * 10) + 0.0;  // never "-0.0"
    line += fmt::format(", error {:+.1f} % ({})", tenths / 10, m.abnormal.value_or(false) ? "abnormal" : "ok");
  }
  if (m.coverage_percent) line += fmt::format(", coverage {:.0f} %", *m.coverage_percent);
  line += fmt::format(", {:.1f} s", m.timings_ms.total / 1000.0);
  if (m.reduced_accuracy) line += ", reduced accuracy: " + m.detail;
  return line;
}

std::string FailureLine(const BinSnapshot& snapshot) {
  if (!snapshot.last) return NameOf(snapshot.bin) + ": not measured yet";
  const ReasonInfo& info = InfoOf(snapshot.last->reason);
  std::string line = fmt::format("{}: no figure ({}): {}", NameOf(snapshot.bin), info.name,
                                 snapshot.last->detail.empty() ? info.meaning : snapshot.last->detail);
  line += snapshot.good ? fmt::format("; held: {} of {}", VolumeText(*snapshot.good), UtcText(snapshot.good->utc))
                        : std::string("; nothing to hold");
  if (!info.remedy.empty()) line += fmt::format(". {}", info.remedy);
  return line;
}

std::string BookLine(const Bin& bin, const BinState::Book& book, const Inventory& of_file) {
  return fmt::format(
      "{}: the book data in force are those of {}, since {}: {}; the file says {}. Committed ones win over the file's "
      "(book_source = \"registers\").",
      NameOf(bin), book.who, UtcText(book.utc), BookToJson(WithBook({}, book.data)).dump(), BookToJson(of_file).dump());
}

std::string InhibitionLine(const Bin& bin, const std::optional<BinState::Inhibition>& inhibition) {
  return fmt::format("{}: inhibited {}; not measured until it is released", NameOf(bin),
                     inhibition ? "by " + inhibition->who + " since " + UtcText(inhibition->utc)
                                : std::string("because the store cannot say whether it was"));
}

}  // namespace granary
