// The table: one row a register, each with the function that takes its value out of a snapshot. Encoding walks the
// rows; what no row claims stays 0.
#include "daemon/modbus/registers.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cstddef>
#include <limits>
#include <optional>
#include <stdexcept>

#include "daemon/modbus/status.h"

namespace granary {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr int kKgPerTonne = 1000;

/// A figure of the published measurement, divided by `Divisor`; NaN where it was not measured.
template <std::optional<double> Measurement::*Figure, int Divisor = 1>
RegisterValue Good(const RegisterSource& source) {
  const auto& good = source.snapshot.good;
  if (!good || !((*good).*Figure)) return kUnknown;
  return *((*good).*Figure) / Divisor;
}

template <double StageTimings_ms::*Stage>
RegisterValue StageTime(const RegisterSource& source) {
  return source.snapshot.good ? source.snapshot.good->timings_ms.*Stage : kUnknown;
}

/// Counters wrap round, as a u32 does.
template <std::uint64_t BinSnapshot::*Counter>
RegisterValue Counted(const RegisterSource& source) {
  return static_cast<std::uint32_t>(source.snapshot.*Counter);
}

template <std::uint64_t RigCounters::*Counter>
RegisterValue OfDevices(const RegisterSource& source) {
  return static_cast<std::uint32_t>(source.snapshot.devices.*Counter);
}

template <std::size_t Side>
RegisterValue MissedFrames(const RegisterSource& source) {
  return static_cast<std::uint32_t>(source.snapshot.devices.missed_frames.at(Side));
}

template <std::uint32_t ModbusCounters::*Counter>
RegisterValue Served(const RegisterSource& source) {
  return source.counters.*Counter;
}

RegisterValue Sequence(const RegisterSource& source) {
  const auto& good = source.snapshot.good;
  return good ? static_cast<std::uint32_t>(good->sequence & 0xFFFF) : std::uint32_t{0};
}

RegisterValue MeasuredAt_s(const RegisterSource& source) {
  if (!source.snapshot.good) return kUnknownU32;
  const auto seconds = std::chrono::floor<std::chrono::seconds>(source.snapshot.good->utc).time_since_epoch().count();
  return seconds < 0 || seconds >= kUnknownU32 ? kUnknownU32 : static_cast<std::uint32_t>(seconds);
}

RegisterValue Age_s(const RegisterSource& source) {
  // A figure from the future means that a clock was set back: its age is not known.
  if (!source.snapshot.good || source.now < source.snapshot.good->utc) return kUnknownU32;
  const auto age = std::chrono::floor<std::chrono::seconds>(source.now - source.snapshot.good->utc).count();
  return age >= kUnknownU32 ? kUnknownU32 : static_cast<std::uint32_t>(age);
}

RegisterValue NextIn_s(const RegisterSource& source) {
  if (!source.snapshot.next_at) return std::uint32_t{kUnknownU16};
  const auto left = std::chrono::ceil<std::chrono::seconds>(*source.snapshot.next_at - source.now).count();
  return static_cast<std::uint32_t>(std::clamp<std::int64_t>(left, 0, kUnknownU16 - 1));
}

RegisterValue LastReason(const RegisterSource& source) {
  const auto& last = source.snapshot.last;
  return static_cast<std::uint32_t>(last ? last->reason : Reason::kNotMeasured);
}

using Source = const RegisterSource&;
using M = Measurement;
constexpr auto kU16 = RegisterType::kU16;
constexpr auto kU32 = RegisterType::kU32;
constexpr auto kF32 = RegisterType::kF32;
constexpr auto kAscii = RegisterType::kAscii;

constexpr RegisterRow kTable[] = {
    {0, kU16, 1, "status", "", "Status bits; see below",
     [](Source s) -> RegisterValue { return std::uint32_t{StatusWord(s.snapshot)}; }},
    {1, kU16, 1, "namur_class", "", "NAMUR NE 107 class; see below",
     [](Source s) -> RegisterValue { return static_cast<std::uint32_t>(NamurClassOf(s.snapshot)); }},
    {2, kU16, 1, "reason", "", "Reason code of the last cycle, 0 ok; see below", LastReason},
    {3, kU16, 1, "validity", "", "Which figures are current; see below",
     [](Source s) -> RegisterValue { return std::uint32_t{ValidityBits(s.snapshot)}; }},
    {4, kU16, 1, "heartbeat", "", "+1 each second while the worker makes progress",
     [](Source s) -> RegisterValue { return std::uint32_t{s.snapshot.heartbeat}; }},
    {5, kU16, 1, "sequence", "", "Number of the published measurement (its low 16 bits)", Sequence},
    {6, kU32, 2, "measured_at", "s", "UTC of the published measurement since 1970-01-01; 4294967295 none",
     MeasuredAt_s},
    {8, kU32, 2, "age", "s", "Age of the published measurement; 4294967295 unknown", Age_s},
    {10, kF32, 2, "volume", "m³", "Volume of the grain", Good<&M::volume_m3>},
    {12, kF32, 2, "volume_percent", "%", "Volume as a share of the bin's capacity", Good<&M::volume_percent>},
    {14, kF32, 2, "level_mean", "m", "Mean height of the grain above z = 0", Good<&M::level_mean_m>},
    {16, kF32, 2, "level_min", "m", "Lowest height of the grain", Good<&M::level_min_m>},
    {18, kF32, 2, "level_max", "m", "Greatest height of the grain", Good<&M::level_max_m>},
    {20, kF32, 2, "distance_mean", "m", "Mean distance from the left camera to the grain", Good<&M::distance_mean_m>},
    {22, kF32, 2, "distance_min", "m", "Least distance from the left camera to the grain", Good<&M::distance_min_m>},
    {24, kF32, 2, "distance_max", "m", "Greatest distance from the left camera to the grain", Good<&M::distance_max_m>},
    {26, kF32, 2, "free_volume", "m³", "Room left up to the top of the bin", Good<&M::free_volume_m3>},
    {28, kF32, 2, "density", "kg/m³", "Density used, before the correction", Good<&M::density_kg_m3>},
    {30, kF32, 2, "quantity", "t", "Volume · correction · density", Good<&M::mass_kg, kKgPerTonne>},
    {32, kF32, 2, "storage_loss", "t", "Storage loss added back to the quantity", Good<&M::loss_kg, kKgPerTonne>},
    {34, kF32, 2, "book_quantity", "t", "Quantity in the books", Good<&M::book_mass_kg, kKgPerTonne>},
    {36, kF32, 2, "error_rate", "%", "(quantity + loss − book) / book, signed", Good<&M::error_rate_percent>},
    {38, kF32, 2, "error_rate_u95", "%", "Expanded uncertainty (k = 2) of the error rate",
     Good<&M::error_rate_u95_percent>},
    {40, kF32, 2, "rate", "m³/h", "Change of volume between the last two valid measurements",
     [](Source s) -> RegisterValue { return s.snapshot.rate_m3_h.value_or(kUnknown); }},
    {42, kF32, 2, "coverage", "%", "Share of the floor under measured triangles", Good<&M::coverage_percent>},
    {44, kF32, 2, "interpolated_volume", "m³", "Part of the volume under interpolated triangles",
     Good<&M::volume_interpolated_m3>},
    {46, kF32, 2, "repeatability", "%", "RSD of the repeats of this cycle; NaN when measured once",
     Good<&M::repeatability_rsd_percent>},
    {48, kF32, 2, "calibration_health", "px", "RMS of the epipolar error", Good<&M::epipolar_rms_px>},
    {50, kF32, 2, "rig_temperature", "°C", "Temperature of the rig", Good<&M::temperature_c>},
    {52, kU32, 2, "alarms_active", "", "Alarm bits; see below",
     [](Source s) -> RegisterValue { return ActiveAlarms(s.snapshot); }},
    {54, kU32, 2, "alarms_latched", "", "Alarm bits, on until acknowledged",
     [](Source s) -> RegisterValue { return LatchedAlarms(s.snapshot); }},
    {56, kU16, 1, "last_failure", "", "Reason code of the newest failed cycle, 0 none",
     [](Source s) -> RegisterValue { return static_cast<std::uint32_t>(s.snapshot.last_failure); }},
    {57, kU16, 1, "last_maintenance", "", "Newest maintenance code, 0 none",
     [](Source) -> RegisterValue { return std::uint32_t{0}; }},
    {58, kU32, 2, "configuration_hash", "", "Changes with the configuration, a calibration or a reference",
     [](Source s) -> RegisterValue { return s.snapshot.configuration_hash; }},
    {60, kU16, 1, "map_version", "", "Version of this map",
     [](Source) -> RegisterValue { return std::uint32_t{kMapVersion}; }},
    {61, kU16, 1, "next_in", "s", "Until the next measurement; 65534 that or more, 65535 none scheduled", NextIn_s},
    {62, kF32, 2, "volume_u95", "m³", "Expanded uncertainty (k = 2) of the volume", Good<&M::volume_u95_m3>},
    {64, kU16, 1, "sequence_check", "", "Equal to register 5 in one read", Sequence},

    {200, kU32, 2, "cycles", "", "Cycles since the start", Counted<&BinSnapshot::cycles>},
    {202, kU32, 2, "failures", "", "Failed cycles since the start", Counted<&BinSnapshot::failures>},
    {204, kU32, 2, "projector_pulses", "", "Projector pulses since the start", OfDevices<&RigCounters::pulses>},
    {206, kF32, 2, "skew", "µs", "Exposure start, left against right", Good<&M::skew_us>},
    {208, kF32, 2, "time_capture", "ms", "Capture, wall clock, of the published measurement",
     StageTime<&StageTimings_ms::capture>},
    {210, kF32, 2, "time_rectify", "ms", "Rectification, wall clock", StageTime<&StageTimings_ms::rectify>},
    {212, kF32, 2, "time_match", "ms", "Matching, wall clock", StageTime<&StageTimings_ms::match>},
    {214, kF32, 2, "time_cloud", "ms", "Points, wall clock", StageTime<&StageTimings_ms::cloud>},
    {216, kF32, 2, "time_segment", "ms", "Removal of the empty bin, wall clock", StageTime<&StageTimings_ms::segment>},
    {218, kF32, 2, "time_mesh", "ms", "Triangulation, wall clock", StageTime<&StageTimings_ms::mesh>},
    {220, kF32, 2, "time_volume", "ms", "Integration, wall clock", StageTime<&StageTimings_ms::volume>},
    {222, kF32, 2, "time_total", "ms", "The whole cycle, wall clock", StageTime<&StageTimings_ms::total>},
    {224, kF32, 2, "pulse", "µs", "How long the projector was lit, measured", Good<&M::pulse_us>},
    {226, kU32, 2, "missed_left", "", "Triggers after which a left camera gave no frame, since the start",
     MissedFrames<0>},
    {228, kU32, 2, "missed_right", "", "Triggers after which a right camera gave no frame, since the start",
     MissedFrames<1>},
    {230, kU32, 2, "mismatched", "", "Pairs refused, as their frames did not belong together, since the start",
     OfDevices<&RigCounters::mismatched>},
    {232, kU32, 2, "reopened", "", "Rigs opened again after trouble, since the start", Counted<&BinSnapshot::reopened>},
    {240, kU32, 2, "clients", "", "Modbus clients connected now", Served<&ModbusCounters::clients>},
    {242, kU32, 2, "requests", "", "Modbus requests answered", Served<&ModbusCounters::requests>},
    {244, kU32, 2, "malformed", "", "Connections closed for what they sent", Served<&ModbusCounters::malformed>},
    {246, kU32, 2, "refused", "", "Connections refused by the allow list", Served<&ModbusCounters::refused>},
    {248, kU32, 2, "evicted", "", "Connections closed to make room for a new one", Served<&ModbusCounters::evicted>},
    {250, kU32, 2, "timed_out", "", "Connections closed as idle, stalled or with an unfinished frame",
     Served<&ModbusCounters::timed_out>},

    {300, kAscii, 8, "vendor", "", "Vendor", [](Source s) -> RegisterValue { return s.identity.vendor; }},
    {308, kAscii, 8, "product", "", "Product", [](Source s) -> RegisterValue { return s.identity.product; }},
    {316, kAscii, 6, "version", "", "Version of the program",
     [](Source s) -> RegisterValue { return s.identity.version; }},
    {322, kAscii, 12, "site", "", "Name of the site", [](Source s) -> RegisterValue { return s.identity.site; }},
    {334, kAscii, 12, "bin_name", "", "Name of the bin", [](Source s) -> RegisterValue { return s.snapshot.bin.name; }},
    {346, kU16, 1, "bin_id", "", "Id of the bin, which is its unit id",
     [](Source s) -> RegisterValue { return static_cast<std::uint32_t>(s.snapshot.bin.id); }},
};

void PutU32(std::uint32_t value, std::span<std::uint16_t> words) {
  words[0] = static_cast<std::uint16_t>(value >> 16);
  words[1] = static_cast<std::uint16_t>(value);
}

void PutText(std::string_view text, std::span<std::uint16_t> words) {
  const std::string_view shown = CutText(text, 2 * words.size());
  for (std::size_t i = 0; i < shown.size(); ++i) {
    const auto byte = static_cast<unsigned char>(shown[i]);
    words[i / 2] = static_cast<std::uint16_t>(words[i / 2] | (i % 2 == 0 ? byte << 8 : byte));
  }
}

}  // namespace

std::string_view NameOf(RegisterType type) {
  switch (type) {
    case RegisterType::kU16:
      return "u16";
    case RegisterType::kU32:
      return "u32";
    case RegisterType::kF32:
      return "f32";
    case RegisterType::kAscii:
      return "ascii";
  }
  throw std::logic_error("register type is not in the list");
}

std::span<const RegisterRow> RegisterTable() { return kTable; }

RegisterImage EncodeRegisters(const RegisterSource& source) {
  RegisterImage image{};
  for (const auto& row : kTable) {
    const std::span words(image.data() + row.address, row.words);
    const RegisterValue value = row.value(source);
    switch (row.type) {
      case RegisterType::kU16:
        words[0] = static_cast<std::uint16_t>(std::get<std::uint32_t>(value));
        break;
      case RegisterType::kU32:
        PutU32(std::get<std::uint32_t>(value), words);
        break;
      case RegisterType::kF32:
        // Not modbus_set_float_abcd: what it calls ABCD changed between the library's releases, and in Debian 12's
        // 3.1.6 its setter and getter disagree.
        PutU32(std::bit_cast<std::uint32_t>(static_cast<float>(std::get<double>(value))), words);
        break;
      case RegisterType::kAscii:
        PutText(std::get<std::string>(value), words);
        break;
    }
  }
  return image;
}

std::string_view CutText(std::string_view text, std::size_t bytes) {
  if (text.size() <= bytes) return text;
  while (bytes > 0 && (static_cast<unsigned char>(text[bytes]) & 0xC0) == 0x80) --bytes;
  return text.substr(0, bytes);
}

bool DiscreteInput(const RegisterImage& image, int address) {
  if (address < 0 || address >= kDiscreteInputCount) throw std::out_of_range("no such discrete input");
  if (address < 16) return (image[0] >> address) & 1;
  const std::uint32_t alarms = (std::uint32_t{image[52]} << 16) | image[53];
  return (alarms >> (address - 16)) & 1;
}

}  // namespace granary
