// Snapshots that the Modbus tests share.
#pragma once

#include <bit>
#include <chrono>
#include <cstdint>

#include "daemon/modbus/registers.h"
#include "daemon/snapshot.h"

namespace granary::test {

inline const UtcTime kMeasuredAt{std::chrono::seconds{1795327200}};  // 2026-11-22T06:00:00Z

inline Measurement GoodMeasurement() {
  Measurement m;
  m.bin = 3;
  m.sequence = 17;
  m.utc = kMeasuredAt;
  m.valid = true;
  m.reason = Reason::kOk;
  m.volume_m3 = 19.5;
  m.volume_u95_m3 = 0.05;
  m.volume_interpolated_m3 = 0.25;
  m.volume_percent = 39.0;
  m.free_volume_m3 = 30.5;
  m.coverage_percent = 97.5;
  m.level_mean_m = 1.5;
  m.level_min_m = 0.75;
  m.level_max_m = 2.25;
  m.distance_mean_m = 3.5;
  m.distance_min_m = 2.75;
  m.distance_max_m = 4.25;
  m.density_kg_m3 = 790;
  m.correction = 1.0;
  m.loss_kg = 12;
  m.mass_kg = 15405;
  m.mass_check_kg = 15417;
  m.book_mass_kg = 15200;
  m.error_rate_percent = 1.4276;
  m.error_rate_u95_percent = 0.5;
  m.abnormal = false;
  m.epipolar_rms_px = 0.125;
  m.skew_us = 40;
  m.timings_ms.total = 512;
  return m;
}

inline Measurement FailedMeasurement(Reason reason) {
  Measurement m;
  m.bin = 3;
  m.sequence = 18;
  m.utc = kMeasuredAt + std::chrono::minutes{30};
  m.reason = reason;
  return m;
}

/// Bin 3, measured a moment ago without a fault.
inline BinSnapshot GoodSnapshot() {
  BinSnapshot s;
  s.bin.id = 3;
  s.bin.name = "bay-3";
  s.good = s.last = GoodMeasurement();
  s.cycles = 70000;
  s.failures = 2;
  s.heartbeat = 41;
  s.configuration_hash = 0xDEADBEEF;
  s.next_at = kMeasuredAt + std::chrono::minutes{30};
  return s;
}

/// The same bin after a cycle that failed.
inline BinSnapshot HeldSnapshot(Reason reason) {
  BinSnapshot s = GoodSnapshot();
  s.last = FailedMeasurement(reason);
  s.held = true;
  s.last_failure = reason;
  return s;
}

/// Bin 3 before its first cycle.
inline BinSnapshot UnmeasuredSnapshot() {
  BinSnapshot s;
  s.bin.id = 3;
  s.bin.name = "bay-3";
  return s;
}

inline const ModbusIdentity kIdentity{.version = "0.1.0", .site = "depot-7"};

inline RegisterImage Encode(const BinSnapshot& snapshot, UtcTime now = kMeasuredAt + std::chrono::seconds{90}) {
  const ModbusCounters counters{.clients = 2, .requests = 5};
  return EncodeRegisters({snapshot, now, kIdentity, counters});
}

inline std::uint32_t U32At(const std::uint16_t* words) { return (std::uint32_t{words[0]} << 16) | words[1]; }
inline std::uint32_t U32At(const RegisterImage& image, int address) { return U32At(image.data() + address); }
inline float F32At(const RegisterImage& image, int address) { return std::bit_cast<float>(U32At(image, address)); }

}  // namespace granary::test
