// The table: one row a register, each with the function that takes its value out of a snapshot.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>

#include "daemon/modbus/registers.h"
#include "daemon/modbus/status.h"

namespace granary {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr int kKgPerTonne = 1000;

using Source = const RegisterSource&;
using M = Measurement;
using Value = RegisterValue (*)(Source);

/// A figure of the published measurement, divided by `Divisor`; NaN where it was not measured.
template <std::optional<double> Measurement::*Figure, int Divisor = 1>
RegisterValue Good(Source source) {
  const auto& good = source.snapshot.good;
  if (!good || !((*good).*Figure)) return kUnknown;
  return *((*good).*Figure) / Divisor;
}

template <double StageTimings_ms::*Stage>
RegisterValue StageTime(Source source) {
  return source.snapshot.good ? source.snapshot.good->timings_ms.*Stage : kUnknown;
}

/// Counters wrap round, as a u32 does.
template <std::uint64_t BinSnapshot::*Counter>
RegisterValue Counted(Source source) {
  return static_cast<std::uint32_t>(source.snapshot.*Counter);
}

template <std::uint64_t RigCounters::*Counter>
RegisterValue OfDevices(Source source) {
  return static_cast<std::uint32_t>(source.snapshot.devices.*Counter);
}

template <std::size_t Side>
RegisterValue MissedFrames(Source source) {
  return static_cast<std::uint32_t>(source.snapshot.devices.missed_frames.at(Side));
}

template <std::uint32_t ModbusCounters::*Counter>
RegisterValue Served(Source source) {
  return source.counters.*Counter;
}

template <Value Figure, int Factor>
RegisterValue Times(Source source) {
  return std::get<double>(Figure(source)) * Factor;
}

template <ByteOrder Order>
RegisterValue Mirror(Source) {
  return static_cast<std::uint32_t>(Order);
}

RegisterValue Sequence(Source source) {
  const auto& good = source.snapshot.good;
  return good ? static_cast<std::uint32_t>(good->sequence & 0xFFFF) : std::uint32_t{0};
}

RegisterValue MeasuredAt_s(Source source) {
  if (!source.snapshot.good) return kUnknownU32;
  const auto seconds = std::chrono::floor<std::chrono::seconds>(source.snapshot.good->utc).time_since_epoch().count();
  return seconds < 0 || seconds >= kUnknownU32 ? kUnknownU32 : static_cast<std::uint32_t>(seconds);
}

RegisterValue Age_s(Source source) {
  // A figure from the future means that a clock was set back: its age is not known.
  if (!source.snapshot.good || source.now < source.snapshot.good->utc) return kUnknownU32;
  const auto age = std::chrono::floor<std::chrono::seconds>(source.now - source.snapshot.good->utc).count();
  return age >= kUnknownU32 ? kUnknownU32 : static_cast<std::uint32_t>(age);
}

RegisterValue NextIn_s(Source source) {
  if (!source.snapshot.next_at) return std::uint32_t{kUnknownU16};
  const auto left = std::chrono::ceil<std::chrono::seconds>(*source.snapshot.next_at - source.now).count();
  return static_cast<std::uint32_t>(std::clamp<std::int64_t>(left, 0, kUnknownU16 - 1));
}

RegisterValue LastReason(Source source) {
  const auto& last = source.snapshot.last;
  return static_cast<std::uint32_t>(last ? last->reason : Reason::kNotMeasured);
}

RegisterValue Rate(Source source) { return source.snapshot.rate_m3_h.value_or(kUnknown); }

RegisterValue Current_mA(Source source) {
  return 4 + 16 * std::get<double>(Good<&M::volume_percent>(source)) / 100;  // live zero: 4 mA empty, 20 mA full
}

/// The figure over its standard uncertainty, as a ratio of amplitudes.
RegisterValue SignalToNoise_dB(Source source) {
  const double volume = std::get<double>(Good<&M::volume_m3>(source));
  const double u95 = std::get<double>(Good<&M::volume_u95_m3>(source));
  const double ratio = std::abs(volume) / (u95 / 2);
  return ratio > 0 && std::isfinite(ratio) ? 20 * std::log10(ratio) : kUnknown;
}

RegisterValue Fahrenheit(Source source) { return std::get<double>(Good<&M::temperature_c>(source)) * 9 / 5 + 32; }

RegisterValue PushedAt_s(Source source) {
  return source.counters.plc_pushed_at == 0 ? kUnknownU32 : source.counters.plc_pushed_at;
}

RegisterValue Command(Source source) { return static_cast<std::uint32_t>(source.snapshot.command.command); }

RegisterValue BookQuantity_t(Source source) {
  const auto& mass_kg = source.snapshot.book.in_force.book_mass_kg;
  return mass_kg ? *mass_kg / kKgPerTonne : kUnknown;
}

RegisterValue BookCommit(Source source) { return static_cast<std::uint32_t>(source.snapshot.book.commit); }

constexpr auto kU16 = RegisterType::kU16;
constexpr auto kU32 = RegisterType::kU32;
constexpr auto kF32 = RegisterType::kF32;
constexpr auto kAscii = RegisterType::kAscii;

constexpr RegisterRow Figure(std::uint16_t address, std::string_view name, std::string_view unit,
                             std::string_view meaning, Value value) {
  return {address, kF32, 2, name, unit, meaning, value, RegisterAccess::kRead, true};
}

/// 1000 times a figure of the summary, which is what takes each of its units to a whole one.
template <Value Of>
constexpr RegisterRow Thousandfold(std::uint16_t address, std::string_view name, std::string_view unit,
                                   std::string_view meaning) {
  return {address, RegisterType::kI32, 2, name, unit, meaning, Times<Of, 1000>, RegisterAccess::kRead, true};
}

constexpr RegisterRow Writable(std::uint16_t address, RegisterType type, std::string_view name, std::string_view unit,
                               std::string_view meaning, Value value) {
  return {address,
          type,
          static_cast<std::uint16_t>(type == kU16 ? 1 : 2),
          name,
          unit,
          meaning,
          value,
          RegisterAccess::kReadWrite};
}

constexpr RegisterRow MirrorRow(std::uint16_t address, std::string_view name, std::string_view meaning, Value order) {
  return {address, RegisterType::kMirror, kMirroredRegisters, name, "", meaning, order};
}

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
    Figure(10, "volume", "m³", "Volume of the grain", Good<&M::volume_m3>),
    Figure(12, "volume_percent", "%", "Volume as a share of the bin's capacity", Good<&M::volume_percent>),
    Figure(14, "level_mean", "m", "Mean height of the grain above z = 0", Good<&M::level_mean_m>),
    Figure(16, "level_min", "m", "Lowest height of the grain", Good<&M::level_min_m>),
    Figure(18, "level_max", "m", "Greatest height of the grain", Good<&M::level_max_m>),
    Figure(20, "distance_mean", "m", "Mean distance from the left camera to the grain", Good<&M::distance_mean_m>),
    Figure(22, "distance_min", "m", "Least distance from the left camera to the grain", Good<&M::distance_min_m>),
    Figure(24, "distance_max", "m", "Greatest distance from the left camera to the grain", Good<&M::distance_max_m>),
    Figure(26, "free_volume", "m³", "Room left up to the top of the bin", Good<&M::free_volume_m3>),
    Figure(28, "density", "kg/m³", "Density used, before the correction", Good<&M::density_kg_m3>),
    Figure(30, "quantity", "t", "Volume · correction · density", Good<&M::mass_kg, kKgPerTonne>),
    Figure(32, "storage_loss", "t", "Storage loss added back to the quantity", Good<&M::loss_kg, kKgPerTonne>),
    Figure(34, "book_quantity", "t", "Quantity in the books", Good<&M::book_mass_kg, kKgPerTonne>),
    Figure(36, "error_rate", "%", "(quantity + loss − book) / book, signed", Good<&M::error_rate_percent>),
    Figure(38, "error_rate_u95", "%", "Expanded uncertainty (k = 2) of the error rate",
           Good<&M::error_rate_u95_percent>),
    Figure(40, "rate", "m³/h", "Change of volume between the last two valid measurements", Rate),
    Figure(42, "coverage", "%", "Share of the floor under measured triangles", Good<&M::coverage_percent>),
    Figure(44, "interpolated_volume", "m³", "Part of the volume under interpolated triangles",
           Good<&M::volume_interpolated_m3>),
    Figure(46, "repeatability", "%", "RSD of the repeats of this cycle; NaN when measured once",
           Good<&M::repeatability_rsd_percent>),
    Figure(48, "calibration_health", "px", "RMS of the epipolar error", Good<&M::epipolar_rms_px>),
    Figure(50, "rig_temperature", "°C", "Temperature of the rig", Good<&M::temperature_c>),
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
    Figure(62, "volume_u95", "m³", "Expanded uncertainty (k = 2) of the volume", Good<&M::volume_u95_m3>),
    {64, kU16, 1, "sequence_check", "", "Equal to register 5 in one read", Sequence},

    Figure(100, "rm5708_distance_mean", "m", "Rosemount 5708, value 1: average distance", Good<&M::distance_mean_m>),
    Figure(102, "rm5708_distance_min", "m", "Value 2: least distance", Good<&M::distance_min_m>),
    Figure(104, "rm5708_distance_max", "m", "Value 3: greatest distance", Good<&M::distance_max_m>),
    Figure(106, "rm5708_volume", "0.001 %", "Value 4: volume as a share of the bin's capacity, times 1000",
           Times<Good<&M::volume_percent>, 1000>),
    Figure(108, "rm5708_current", "mA", "Value 5: the share of the capacity as a current, 4 mA empty, 20 mA full",
           Current_mA),
    Figure(110, "rm5708_snr", "dB", "Value 6: 20 · log10 of the volume over its standard uncertainty (u95 / 2)",
           SignalToNoise_dB),
    Figure(112, "rm5708_temperature_c", "°C", "Value 7: temperature of the rig", Good<&M::temperature_c>),
    Figure(114, "rm5708_temperature_f", "°F", "Value 8: temperature of the rig", Fahrenheit),
    Figure(116, "rm5708_level_mean", "m", "Value 9: average level", Good<&M::level_mean_m>),
    Figure(118, "rm5708_density", "g/cm³", "Value 10: bulk density", Good<&M::density_kg_m3, 1000>),
    Figure(120, "rm5708_mass", "t", "Value 11: mass", Good<&M::mass_kg, kKgPerTonne>),
    {122, kF32, 2, "rm5708_serial", "", "Value 12: serial number",
     [](Source s) -> RegisterValue { return static_cast<double>(s.identity.serial); }},
    {124, kF32, 2, "rm5708_tag", "", "Value 13: id of the bin",
     [](Source s) -> RegisterValue { return static_cast<double>(s.snapshot.bin.id); }},

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
    {234, kU32, 2, "restarts", "", "Starts of the daemon, but the first, since its records began",
     [](Source s) -> RegisterValue { return s.snapshot.restarts; }},
    {240, kU32, 2, "clients", "", "Modbus clients connected now", Served<&ModbusCounters::clients>},
    {242, kU32, 2, "requests", "", "Modbus requests answered", Served<&ModbusCounters::requests>},
    {244, kU32, 2, "malformed", "", "Connections closed for what they sent", Served<&ModbusCounters::malformed>},
    {246, kU32, 2, "refused", "", "Connections refused by the allow list, or for want of a good certificate",
     Served<&ModbusCounters::refused>},
    {248, kU32, 2, "evicted", "", "Connections closed to make room for a new one", Served<&ModbusCounters::evicted>},
    {250, kU32, 2, "timed_out", "", "Connections closed as idle, stalled or with an unfinished frame",
     Served<&ModbusCounters::timed_out>},
    {252, kU32, 2, "writes", "", "Requests that wrote", Served<&ModbusCounters::writes>},
    {254, kU32, 2, "writes_refused", "", "Writes from where nobody may write", Served<&ModbusCounters::writes_refused>},
    {256, kU32, 2, "rtu_requests", "", "Serial line: requests for us, answered", Served<&ModbusCounters::rtu_requests>},
    {258, kU32, 2, "rtu_others", "", "Serial line: good frames that are not for us",
     Served<&ModbusCounters::rtu_others>},
    {260, kU32, 2, "rtu_errors", "", "Serial line: noise, half frames and wrong checksums",
     Served<&ModbusCounters::rtu_errors>},
    {262, kU32, 2, "plc_connected", "", "1 while the PLC that we push to is connected",
     Served<&ModbusCounters::plc_connected>},
    {264, kU32, 2, "plc_pushes", "", "Blocks that the PLC has taken", Served<&ModbusCounters::plc_pushes>},
    {266, kU32, 2, "plc_failures", "", "PLC: connections and writes that failed, read-backs that differed",
     Served<&ModbusCounters::plc_failures>},
    {268, kU32, 2, "plc_pushed_at", "s", "UTC of the newest block that the PLC has taken; 4294967295 none", PushedAt_s},

    {300, kAscii, 8, "vendor", "", "Vendor", [](Source s) -> RegisterValue { return s.identity.vendor; }},
    {308, kAscii, 8, "product", "", "Product", [](Source s) -> RegisterValue { return s.identity.product; }},
    {316, kAscii, 6, "version", "", "Version of the program",
     [](Source s) -> RegisterValue { return s.identity.version; }},
    {322, kAscii, 12, "site", "", "Name of the site", [](Source s) -> RegisterValue { return s.identity.site; }},
    {334, kAscii, 12, "bin_name", "", "Name of the bin", [](Source s) -> RegisterValue { return s.snapshot.bin.name; }},
    {346, kU16, 1, "bin_id", "", "Id of the bin, which is its unit id",
     [](Source s) -> RegisterValue { return static_cast<std::uint32_t>(s.snapshot.bin.id); }},

    Writable(900, kU16, "byte_order", "", "Of the 32-bit values of 0–899: 0 ABCD, 1 CDAB, 2 DCBA, 3 BADC",
             [](Source s) -> RegisterValue { return static_cast<std::uint32_t>(s.snapshot.format.byte_order); }),
    Writable(901, kU16, "invalid_policy", "",
             "What a figure shows that is not current: 0 the last good one, 1 a quiet NaN, 2 −9999",
             [](Source s) -> RegisterValue { return static_cast<std::uint32_t>(s.snapshot.format.invalid); }),
    Writable(910, kU16, "command", "", "1 measure now, 2 acknowledge, 3 inhibit, 4 release, 0 end the handshake",
             Command),
    {911, kU16, 1, "command_echo", "", "The command that was taken last", Command},
    {912, kU16, 1, "command_result", "", "Of that command: 0 idle, 1 busy, 2 done, 3 rejected",
     [](Source s) -> RegisterValue { return static_cast<std::uint32_t>(s.snapshot.command.result); }},
    Writable(920, kF32, "set_book_quantity", "t", "Book quantity, in force or staged", BookQuantity_t),
    Writable(922, kF32, "set_density", "kg/m³", "Density before the correction, in force or staged",
             [](Source s) -> RegisterValue { return s.snapshot.book.in_force.density_kg_m3.value_or(kUnknown); }),
    Writable(924, kF32, "set_correction", "", "Factor on the density, in force or staged",
             [](Source s) -> RegisterValue { return s.snapshot.book.in_force.correction; }),
    Writable(926, kF32, "set_loss", "t", "Storage loss, in force or staged",
             [](Source s) -> RegisterValue { return s.snapshot.book.in_force.loss_kg / kKgPerTonne; }),
    Writable(930, kU16, "book_commit", "",
             "1 commits 920–927, all or nothing; reads 0 nothing staged, 1 staged or busy, 2 done, 3 rejected",
             BookCommit),

    MirrorRow(2000, "mirror_abcd", "Registers 0–125 again, always ABCD", Mirror<ByteOrder::kAbcd>),
    MirrorRow(2200, "mirror_cdab", "Registers 0–125 again, always CDAB", Mirror<ByteOrder::kCdab>),
    MirrorRow(2400, "mirror_dcba", "Registers 0–125 again, always DCBA", Mirror<ByteOrder::kDcba>),
    MirrorRow(2600, "mirror_badc", "Registers 0–125 again, always BADC", Mirror<ByteOrder::kBadc>),

    Thousandfold<Good<&M::volume_m3>>(3000, "volume_i32", "L", "1000 times register 10; −2147483648 unknown"),
    Thousandfold<Good<&M::volume_percent>>(3002, "volume_percent_i32", "0.001 %",
                                           "1000 times register 12; −2147483648 unknown"),
    Thousandfold<Good<&M::level_mean_m>>(3004, "level_mean_i32", "mm", "1000 times register 14; −2147483648 unknown"),
    Thousandfold<Good<&M::level_min_m>>(3006, "level_min_i32", "mm", "1000 times register 16; −2147483648 unknown"),
    Thousandfold<Good<&M::level_max_m>>(3008, "level_max_i32", "mm", "1000 times register 18; −2147483648 unknown"),
    Thousandfold<Good<&M::distance_mean_m>>(3010, "distance_mean_i32", "mm",
                                            "1000 times register 20; −2147483648 unknown"),
    Thousandfold<Good<&M::distance_min_m>>(3012, "distance_min_i32", "mm",
                                           "1000 times register 22; −2147483648 unknown"),
    Thousandfold<Good<&M::distance_max_m>>(3014, "distance_max_i32", "mm",
                                           "1000 times register 24; −2147483648 unknown"),
    Thousandfold<Good<&M::free_volume_m3>>(3016, "free_volume_i32", "L", "1000 times register 26; −2147483648 unknown"),
    Thousandfold<Good<&M::density_kg_m3>>(3018, "density_i32", "g/m³", "1000 times register 28; −2147483648 unknown"),
    Thousandfold<Good<&M::mass_kg, kKgPerTonne>>(3020, "quantity_i32", "kg",
                                                 "1000 times register 30; −2147483648 unknown"),
    Thousandfold<Good<&M::loss_kg, kKgPerTonne>>(3022, "storage_loss_i32", "kg",
                                                 "1000 times register 32; −2147483648 unknown"),
    Thousandfold<Good<&M::book_mass_kg, kKgPerTonne>>(3024, "book_quantity_i32", "kg",
                                                      "1000 times register 34; −2147483648 unknown"),
    Thousandfold<Good<&M::error_rate_percent>>(3026, "error_rate_i32", "0.001 %",
                                               "1000 times register 36; −2147483648 unknown"),
    Thousandfold<Good<&M::error_rate_u95_percent>>(3028, "error_rate_u95_i32", "0.001 %",
                                                   "1000 times register 38; −2147483648 unknown"),
    Thousandfold<Rate>(3030, "rate_i32", "L/h", "1000 times register 40; −2147483648 unknown"),
    Thousandfold<Good<&M::coverage_percent>>(3032, "coverage_i32", "0.001 %",
                                             "1000 times register 42; −2147483648 unknown"),
    Thousandfold<Good<&M::volume_interpolated_m3>>(3034, "interpolated_volume_i32", "L",
                                                   "1000 times register 44; −2147483648 unknown"),
    Thousandfold<Good<&M::repeatability_rsd_percent>>(3036, "repeatability_i32", "0.001 %",
                                                      "1000 times register 46; −2147483648 unknown"),
    Thousandfold<Good<&M::epipolar_rms_px>>(3038, "calibration_health_i32", "0.001 px",
                                            "1000 times register 48; −2147483648 unknown"),
    Thousandfold<Good<&M::temperature_c>>(3040, "rig_temperature_i32", "0.001 °C",
                                          "1000 times register 50; −2147483648 unknown"),
    Thousandfold<Good<&M::volume_u95_m3>>(3042, "volume_u95_i32", "L", "1000 times register 62; −2147483648 unknown"),
};

}  // namespace

std::span<const RegisterRow> RegisterTable() { return kTable; }

}  // namespace granary
